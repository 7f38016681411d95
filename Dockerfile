# One image for every role: the command says which process a container is.
#
# PyTorch comes from wheels of yours, so that no gigabytes of CUDA are fetched by chance. Give one of
#   --build-arg TORCH_INDEX_URL=<address of an index of CPU wheels>
#   --build-arg TORCH_WHEELS=<folder of the build context>    default: wheels, which `make wheels` fills
FROM python:3.11-slim-bookworm AS dependencies
ARG TORCH=torch==2.13.0
ARG TORCH_INDEX_URL=
ARG TORCH_WHEELS=wheels
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
RUN python3 -m venv /opt/venv
# The star lets the folder be missing; what is copied here stays in this stage.
COPY pyproject.toml ${TORCH_WHEELS}* /wheels/
RUN if [ -z "$TORCH_INDEX_URL" ] && ! ls /wheels/torch-*.whl >/dev/null 2>&1; then \
      echo "No PyTorch: got neither a wheel in the folder $TORCH_WHEELS nor a TORCH_INDEX_URL." \
           "Run 'make wheels', or build with --build-arg TORCH_INDEX_URL=<index of CPU wheels>." >&2; exit 1; \
    fi \
 && /opt/venv/bin/pip install --quiet --find-links /wheels ${TORCH_INDEX_URL:+--index-url "$TORCH_INDEX_URL"} "$TORCH"
# From pyproject.toml alone: this layer, nearly all of the image, outlives every change of the sources.
RUN /opt/venv/bin/python -c "import tomllib; print(*tomllib.load(open('/wheels/pyproject.toml', 'rb'))['project']['dependencies'], sep='\n')" >/tmp/requirements.txt \
 && /opt/venv/bin/pip install --quiet --find-links /wheels --requirement /tmp/requirements.txt

FROM dependencies AS package
COPY pyproject.toml README.md LICENSE /source/
# The four folders and the links to them in jouleswarm: one package.
COPY agents /source/agents
COPY broker /source/broker
COPY common /source/common
COPY datacenter /source/datacenter
COPY jouleswarm /source/jouleswarm
RUN /opt/venv/bin/pip install --quiet --no-deps --prefix /package /source

FROM python:3.11-slim-bookworm
RUN useradd --system --uid 10001 --no-create-home --home-dir /tmp --shell /usr/sbin/nologin jouleswarm \
 && install -d -o 10001 -g 10001 /runs /keys /state \
 && for client in broker health recorder datacenter $(seq -f agent-%g 12); do \
      install -d -o 10001 -g 10001 "/handed/$client"; done
COPY --from=dependencies /opt/venv /opt/venv
COPY --from=package /package /opt/venv
COPY jouleswarm/scenarios /app/scenarios
COPY deploy/broker_health.py deploy/wait_for.py /app/deploy/
WORKDIR /app
# All that is written at run time goes to /tmp, /runs, /keys, /handed and /state: the rest of the file system can be read-only.
# One thread of arithmetic a process: robots share the cores, and results do not depend on their number.
ENV PATH=/opt/venv/bin:$PATH HOME=/tmp MPLCONFIGDIR=/tmp/matplotlib \
    PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1 \
    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
USER 10001:10001
CMD ["jouleswarm", "--help"]
