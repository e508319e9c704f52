"""The API's description: ``python -m service.openapi [--check]`` writes openapi/openapi.json.

FastAPI describes every answer as ``application/json`` and its own validation error as 422; here
refusals get the media type and the body that they really have. It also lets headers be null.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

FILE = Path(__file__).resolve().parents[1] / "openapi" / "openapi.json"
_PROBLEM = {"$ref": "#/components/schemas/ProblemBody"}
_UNUSED = ("HTTPValidationError", "ValidationError")


def describe(app: FastAPI) -> dict[str, Any]:
    """The description of the application, made once and kept."""
    if app.openapi_schema is None:
        schema = get_openapi(
            title=app.title,
            version=app.version,
            summary=app.summary,
            description=app.description,
            routes=app.routes,
        )
        for path in schema["paths"].values():
            for operation in path.values():
                _mend(operation)
        for name in _UNUSED:
            schema["components"]["schemas"].pop(name, None)
        app.openapi_schema = schema
    return app.openapi_schema


def _mend(operation: dict[str, Any]) -> None:
    for parameter in operation.get("parameters", ()):
        parameter["schema"] = _without_null(parameter["schema"])
    answers = operation["responses"]
    if answers.get("422", {}).get("description") == "Validation Error":
        del answers["422"]
    for status, answer in answers.items():
        if int(status) >= 400:
            content = answer.setdefault("content", {})
            content.pop("application/json", None)
            content.setdefault("application/problem+json", {})["schema"] = _PROBLEM


def _without_null(schema: dict[str, Any]) -> dict[str, Any]:
    """A header or a query can be left out, but not be null."""
    kinds = [kind for kind in schema.get("anyOf", ()) if kind != {"type": "null"}]
    if len(kinds) != 1:
        return schema
    return {**kinds[0], **{name: value for name, value in schema.items() if name != "anyOf"}}


def allowed_methods(app: FastAPI, path: str) -> str:
    """Every method of an address; a route that refuses one knows only its own."""
    methods: set[str] = set()
    for template, operations in app.openapi()["paths"].items():
        if re.fullmatch(re.sub(r"\{\w+\}", "[^/]+", template), path):
            methods |= {method.upper() for method in operations}
    return ", ".join(sorted(methods))


def text() -> str:
    """The file's content for the code as it is."""
    from service.main import create_app
    from service.settings import load_settings

    return json.dumps(describe(create_app(load_settings())), indent=2, ensure_ascii=False) + "\n"


def main() -> int:
    made = text()
    if "--check" not in sys.argv:
        FILE.parent.mkdir(exist_ok=True)
        FILE.write_text(made)
        return 0
    if FILE.exists() and FILE.read_text() == made:
        return 0
    print("openapi/openapi.json is not what the code says; run `make openapi`.", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
