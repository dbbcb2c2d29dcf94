# The data factory. Built from the root of the repository: docker build -f docker/datagen.Dockerfile .
FROM debian:trixie-slim

COPY docker/left-out.cfg /etc/dpkg/dpkg.cfg.d/left-out

# The packages of the Makefile. Debian 13 keeps the upstream versions; * stands for its own fixes.
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        gcc=4:14.2.0-* \
        libopenblas0-serial=0.3.29+ds-* \
        openmpi-bin=5.0.7-* \
        python3-dolfinx=1:0.9.0-* \
        python3-gmsh=4.13.1+ds1-* \
        python3-h5py=3.13.0-* \
        python3-matplotlib=3.10.1+dfsg1-* \
        python3-meshio=7.0.0-really-5.3.5-* \
        python3-venv=3.13.5-* \
        python3-yaml=6.0.2-* \
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
    && pip install --no-cache-dir --constraint /opt/constraints.txt pydantic shtab tqdm \
    && pip install --no-cache-dir --no-deps --constraint /opt/constraints.txt \
        lazy-loader pytetwild scikit-image simpleitk

COPY shared_schema /opt/source/shared_schema
COPY datagen /opt/source/datagen
RUN pip install --no-cache-dir --no-deps /opt/source/shared_schema /opt/source/datagen

# Only ranks run in parallel, also more than there are cores. They copy through shared memory;
# containers forbid single copies.
ENV HOME=/home/worker OMP_NUM_THREADS=1 OMPI_MCA_smsc=^cma OMPI_MCA_reachable=weighted \
    PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe
USER 1000
WORKDIR /work
CMD ["datagen", "--help"]
HEALTHCHECK --interval=5m --timeout=1m CMD ["datagen", "--version"]

ARG REVISION=unknown
LABEL org.opencontainers.image.title="datagen" \
    org.opencontainers.image.description="Neo-Hookean equilibria under random nodal loads, written as datasets" \
    org.opencontainers.image.version="1.0.0" \
    org.opencontainers.image.licenses="MIT" \
    org.opencontainers.image.revision="$REVISION"
