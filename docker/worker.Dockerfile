# A worker. The default torch from the package index is the CUDA build; for a CPU worker give
# TORCH_OPTIONS, such as the options that name an index of CPU builds.
#   docker build -f docker/worker.Dockerfile -t visco-worker .
FROM python:3.11-slim AS build
ARG TORCH=torch==2.13.0
ARG TORCH_OPTIONS=
WORKDIR /source
RUN python -m venv /opt/visco \
    && /opt/visco/bin/pip install --no-cache-dir ${TORCH} ${TORCH_OPTIONS}
COPY pyproject.toml README.md constraints.txt ./
COPY visco_core visco_core
COPY service service
COPY worker worker
RUN /opt/visco/bin/pip install --no-cache-dir -c constraints.txt ".[postgres,s3]"

FROM python:3.11-slim
RUN apt-get update \
    && apt-get install --yes --no-install-recommends libgomp1 \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --system --uid 10001 --create-home visco && install -d -o visco /data
COPY --from=build /opt/visco /opt/visco
# Compiled kernels are kept on the volume, so that a restarted container is warm.
ENV PATH=/opt/visco/bin:$PATH \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    NUMBA_CACHE_DIR=/data/kernels \
    TRITON_CACHE_DIR=/data/kernels \
    VISCO_DATA_DIR=/data \
    VISCO_LOG_FORMAT=json
USER visco
VOLUME /data
HEALTHCHECK --interval=15s --timeout=10s --start-period=60s CMD ["python", "-m", "worker.health"]
STOPSIGNAL SIGTERM
ENTRYPOINT ["visco"]
CMD ["worker"]
