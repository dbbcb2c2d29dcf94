# The data factory. Built from the root of the repository: docker build -f docker/datagen.Dockerfile .
FROM debian:bookworm-slim

COPY docker/left-out.cfg /etc/dpkg/dpkg.cfg.d/left-out

# The packages of the Makefile. Debian 12 keeps the upstream versions; * stands for its own fixes.
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        gcc=4:12.2.0-* \
        openmpi-bin=4.1.4-* \
        python3-dolfinx=1:0.5.2-* \
        python3-gmsh=4.8.4+ds2-* \
        python3-h5py=3.7.0-* \
        python3-matplotlib=3.6.3-* \
        python3-meshio=7.0.0-* \
        python3-venv=3.11.2-* \
        python3-yaml=6.0-* \
    && apt-get clean \
    && rm -rf /var/lib/apt/lists/*

# A home folder that any user may write to: compiled forms are cached there.
RUN useradd --uid 1000 --create-home worker \
    && chmod 1777 /home/worker \
    && install --directory --owner=worker /work

# Debian's interpreter, which its dolfinx, NumPy and h5py are built for; pip replaces none of them.
ENV PATH=/opt/venv/bin:$PATH
COPY docker/constraints.txt /opt/
ARG PIP_CONSTRAINT=/opt/constraints.txt
RUN /usr/bin/python3 -m venv --system-site-packages /opt/venv \
    && pip install --no-cache-dir --constraint /opt/constraints.txt pydantic tqdm

COPY shared_schema /opt/source/shared_schema
COPY datagen /opt/source/datagen
RUN pip install --no-cache-dir --no-deps /opt/source/shared_schema /opt/source/datagen

# Only ranks run in parallel. They copy through shared memory; containers forbid single copies.
ENV HOME=/home/worker OMP_NUM_THREADS=1 OMPI_MCA_btl_vader_single_copy_mechanism=none
USER 1000
WORKDIR /work
CMD ["datagen", "--help"]
HEALTHCHECK --interval=5m --timeout=1m CMD ["datagen", "--version"]

ARG REVISION=unknown
LABEL org.opencontainers.image.title="datagen" \
    org.opencontainers.image.description="Neo-Hookean equilibria under random nodal loads, written as datasets" \
    org.opencontainers.image.version="0.1.0" \
    org.opencontainers.image.licenses="MIT" \
    org.opencontainers.image.revision="$REVISION"
