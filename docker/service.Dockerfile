# The API and the dashboard: no torch, no solver libraries. Build from the project's root:
#   docker build -f docker/service.Dockerfile -t visco-service .
FROM node:22-slim AS dashboard
WORKDIR /source/service/dashboard
COPY service/dashboard ./
COPY openapi /source/openapi
COPY visco_core/samples /source/visco_core/samples
RUN npm ci --no-audit --no-fund && npm run types && npm run build

FROM python:3.11-slim AS build
WORKDIR /source
COPY pyproject.toml README.md constraints.txt ./
COPY visco_core visco_core
COPY service service
COPY worker worker
COPY --from=dashboard /source/service/dashboard/dist service/dashboard/dist
COPY docker/service-requirements.txt ./
RUN python -m venv /opt/visco \
    && /opt/visco/bin/pip install --no-cache-dir -c constraints.txt -r service-requirements.txt \
    && VISCO_CPU=x86_64_v2 /opt/visco/bin/pip install --no-cache-dir --no-deps .

FROM python:3.11-slim
RUN useradd --system --uid 10001 --create-home visco && install -d -o visco /data
COPY --from=build /opt/visco /opt/visco
ENV PATH=/opt/visco/bin:$PATH \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    VISCO_DATA_DIR=/data \
    VISCO_HOST=0.0.0.0 \
    VISCO_LOG_FORMAT=json
USER visco
VOLUME /data
EXPOSE 8000
HEALTHCHECK --interval=10s --timeout=3s --start-period=20s CMD ["python", "-c", \
    "import urllib.request; urllib.request.urlopen('http://127.0.0.1:8000/healthz', timeout=2)"]
ENTRYPOINT ["visco"]
CMD ["api"]
