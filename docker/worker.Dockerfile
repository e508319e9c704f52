# A worker. The default torch from the package index is the CUDA build; for a CPU worker give
# TORCH_OPTIONS, such as the options that name an index of CPU builds.
#   docker build -f docker/worker.Dockerfile -t visco-worker .
FROM python:3.11-slim AS build
ARG TORCH=torch==2.13.0
ARG TORCH_OPTIONS=
# What the kernels are compiled for: the oldest processor that the image runs on.
ARG CPU=x86_64_v3
WORKDIR /source
RUN python -m venv /opt/visco \
    && /opt/visco/bin/pip install --no-cache-dir ${TORCH} ${TORCH_OPTIONS}
COPY pyproject.toml README.md constraints.txt ./
COPY visco_core visco_core
COPY service service
COPY worker worker
RUN VISCO_CPU=${CPU} /opt/visco/bin/pip install --no-cache-dir -c constraints.txt ".[postgres,s3]"

FROM python:3.11-slim
RUN apt-get update \
    && apt-get install --yes --no-install-recommends libgomp1 \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --system --uid 10001 --create-home visco && install -d -o visco /data
COPY --from=build /opt/visco /opt/visco
ENV PATH=/opt/visco/bin:$PATH \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    VISCO_DATA_DIR=/data \
    VISCO_LOG_FORMAT=json
USER visco
VOLUME /data
HEALTHCHECK --interval=15s --timeout=10s --start-period=60s CMD ["python", "-m", "worker.health"]
STOPSIGNAL SIGTERM
ENTRYPOINT ["visco"]
CMD ["worker"]
