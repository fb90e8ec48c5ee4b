# Skinmap in a container; `docker run` runs the demo into /out:
#   docker build -t skinmap . && docker run --rm -v "$PWD/demo:/out" skinmap
FROM python:3.12-slim-bookworm

# What VTK, pymeshlab and the compiled loops need of the system (scripts/system_packages.py).
RUN apt-get update \
    && apt-get install -y --no-install-recommends libgl1 libegl1 libopengl0 libgomp1 \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /skinmap
COPY . .
# EXTRAS: such as [fast,ros,foxglove,zenoh]
ARG EXTRAS=""
RUN pip install --no-cache-dir -c constraints.txt ".${EXTRAS}" && mkdir /out

ENTRYPOINT ["skinmap"]
CMD ["demo", "--out", "/out"]
