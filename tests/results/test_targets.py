import zlib

import numpy as np
import pytest

from duobench.errors import EvaluationError
from duobench.results.targets import pack_targets, unpack_targets
from tests.results.samples import sample_record

SHAPE = (40, 16)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_targets_come_back_to_the_bit(kind: type) -> None:
    sent = np.random.default_rng(0).standard_normal(SHAPE).astype(kind)
    assert np.array_equal(unpack_targets(pack_targets(sent), len(sent)), sent)


def test_float32_takes_half_the_room() -> None:
    sent = np.random.default_rng(0).standard_normal(SHAPE)
    assert len(pack_targets(sent.astype(np.float32))) < 0.6 * len(pack_targets(sent))


def test_no_step_has_no_targets() -> None:
    assert unpack_targets(pack_targets([]), 0).shape == (0, 16)


@pytest.mark.parametrize(
    "content",
    [b"", b"rubbish", pack_targets(np.zeros((31, 16))), zlib.compress(b"\0" * 10_000_000)],
    ids=["empty", "rubbish", "another length", "a bomb"],
)
def test_damaged_targets_are_refused(content: bytes) -> None:
    record = sample_record(reached=(10, 20, 30), sent=content)
    with pytest.raises(EvaluationError, match="joint targets"):
        record.targets()
