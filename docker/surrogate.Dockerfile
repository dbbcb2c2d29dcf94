# The learner. Built from the root of the repository: docker build -f docker/surrogate.Dockerfile .
FROM debian:trixie-slim

COPY docker/left-out.cfg /etc/dpkg/dpkg.cfg.d/left-out

# g++ and Python's headers serve `training.compile`.
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        g++=4:14.2.0-* \
        python3-dev=3.13.5-* \
        python3-venv=3.13.5-* \
    && apt-get clean \
    && rm -rf /var/lib/apt/lists/*

# A home folder that any user may write to: matplotlib, Numba and PyTorch keep caches there.
RUN useradd --uid 1000 --create-home worker \
    && chmod 1777 /home/worker \
    && install --directory --owner=worker /work

# PyTorch first, by far the largest package. PyPI's is for CUDA and CPUs, with CUDA's libraries.
ENV PATH=/opt/venv/bin:$PATH
COPY docker/constraints.txt /opt/
ARG PIP_CONSTRAINT=/opt/constraints.txt
ARG PIP_EXTRA_INDEX_URL
ARG TORCH=torch==2.13.0
RUN python3 -m venv /opt/venv \
    && pip install --no-cache-dir --constraint /opt/constraints.txt "$TORCH"
RUN pip install --no-cache-dir --constraint /opt/constraints.txt \
    filelock h5py jinja2 matplotlib meshio numba numpy pydantic pyyaml safetensors scikit-learn scipy shtab \
    threadpoolctl tqdm onnx onnxruntime onnxscript tensorboard

COPY shared_schema /opt/source/shared_schema
COPY surrogate /opt/source/surrogate
RUN pip install --no-cache-dir --no-deps /opt/source/shared_schema /opt/source/surrogate \
    && pip check

ENV HOME=/home/worker NVIDIA_VISIBLE_DEVICES=all NVIDIA_DRIVER_CAPABILITIES=compute,utility
USER 1000
WORKDIR /work
CMD ["surrogate", "--help"]
HEALTHCHECK --interval=5m --timeout=1m CMD ["surrogate", "--version"]

ARG REVISION=unknown
LABEL org.opencontainers.image.title="surrogate" \
    org.opencontainers.image.description="U-Net surrogates of large-deformation solids, trained and judged" \
    org.opencontainers.image.version="1.0.0" \
    org.opencontainers.image.licenses="MIT" \
    org.opencontainers.image.revision="$REVISION"
