"""Models, resets and replays have the same bits whatever kernels the processor's type chooses.

`python -m dev.benchmarks.sweep --kernels` compares more variants, more seeds, and the experts.
"""

import pytest

from dev.benchmarks import kernels
from duobench.tasks import catalog

SEED = 3


@pytest.fixture(scope="module")
def found() -> dict[str, kernels.Found]:
    return kernels.compare(kernels.playable(kernels.QUICK), catalog.names(), [SEED])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["models", "resets", "replays"])
def test_every_kernel_gives_the_same_bits(found: dict[str, kernels.Found], kind: str) -> None:
    first, *others = found.values()
    assert len(first[kind]) == len(catalog.names())
    for other in others:
        assert other[kind] == first[kind]


@pytest.mark.slow
@pytest.mark.skipif(not kernels.has_avx512(), reason="this processor has no AVX-512")
def test_the_switches_have_an_effect(found: dict[str, kernels.Found]) -> None:
    narrow, haswell, skylakex = (found[name]["probe"] for name in kernels.QUICK)
    assert narrow["blas"] == haswell["blas"] != skylakex["blas"]
    assert narrow["loops"] != haswell["loops"] == skylakex["loops"]
