# DuoBench on a processor: tasks, experts, evaluation and its pages; no graphics card, no training.
#
#     docker build --tag duobench .
#     docker run --rm --volume "$PWD:/runs" duobench eval --policy expert --tasks bin_sort --out first
FROM debian:bookworm-slim

RUN apt-get update \
    && apt-get install --yes --no-install-recommends \
        python3 python3-venv libegl1 libopengl0 libgl1 libgl1-mesa-dri \
    && rm -rf /var/lib/apt/lists/*

COPY pyproject.toml constraints.txt README.md LICENSE THIRD_PARTY_NOTICES.md /src/
COPY src /src/src
RUN python3 -m venv /duobench \
    && /duobench/bin/pip install --no-cache-dir --disable-pip-version-check -c /src/constraints.txt /src \
    && rm -rf /src

RUN useradd --create-home --uid 1000 runner && mkdir /runs && chown runner /runs
ENV PATH=/duobench/bin:/usr/local/bin:/usr/bin:/bin MUJOCO_GL=egl
USER runner
WORKDIR /runs
ENTRYPOINT ["duobench"]
CMD ["doctor"]
