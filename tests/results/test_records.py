import json
import re
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import EvaluationError, FileError
from duobench.core.files import encode, read, write
from duobench.results.records import RECORD_SCHEMA, EpisodeRecord, pack_targets, unpack_targets
from duobench.tasks.shifts.shift import Shift
from tests.results.samples import LIFT, sample_record, sample_records, sample_run

TEXT = encode(sample_record(), RECORD_SCHEMA)
RECORDS = [*sample_records(sample_run()), sample_record(reached=(5,), error="boom\n")]


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: f"{record.task}-{record.episode}")
def test_record_survives_its_file(record: EpisodeRecord, tmp_path: Path) -> None:
    write(tmp_path / "r.json", encode(record, RECORD_SCHEMA))
    assert read_record(tmp_path / "r.json") == record
    assert (tmp_path / "r.json").read_text() == encode(record, RECORD_SCHEMA)


def test_text_has_a_field_a_line() -> None:
    assert '\n  "stage_changes": [[10, 1], [20, 2], [30, 3]],\n' in TEXT
    assert json.loads(TEXT)["schema"] == RECORD_SCHEMA


def test_stage_after_a_step_is_the_last_one_reached() -> None:
    record = sample_record()
    stages = {step: record.stage_after(step) for step in (0, 9, 10, 19, 20, 30, 90)}
    assert stages == {0: 0, 9: 0, 10: 1, 19: 1, 20: 2, 30: 3, 90: 3}
    assert sample_record(LIFT, reached=(7,)).progress == 0.5


def test_condition_has_a_readable_name_that_no_other_has() -> None:
    usual = sample_record().condition
    assert usual.name == "mine.sim.none.default"
    shift = Shift(axis="look", level=3)
    named = [
        replace(usual, policy=policy)
        for policy in ("a:b", "a/b", "a-b", "ä.b", "../../x", "x" * 99, "x" * 98, "", "π")
    ]
    names = [each.name for each in (usual, replace(usual, shift=shift), *named)]
    assert names[1] == "mine.sim.look-3.default"
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r"[A-Za-z0-9_-]*(\.[A-Za-z0-9_-]+){3}", name) for name in names)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"final_stage": 2}, "final_stage must be the last stage"),
        ({"success": False}, "success must mean"),
        ({"error": "boom", "success": True}, "success must mean"),
        ({"stage_changes": ((20, 1), (10, 3))}, "rise"),
        ({"stage_changes": ((10, 2), (20, 2), (30, 3))}, "rise"),
        ({"stage_changes": ((10, 1), (30, 4)), "final_stage": 4}, "0..max_stage"),
        ({"stage_changes": ((10, 1), (31, 3))}, "within the executed steps"),
        ({"steps": 91}, "horizon"),
        ({"attempt": 2}, "attempts count from 1"),
        ({"late_success": 91}, "late_success must come after"),
        ({"reached": (5,), "late_success": 90}, "late_success must come after"),
        ({"reached": (5,), "error": "boom", "late_success": 91}, "late_success must come after"),
    ],
)
def test_record_that_contradicts_itself_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(EvaluationError, match=message):
        sample_record(**changes)


def read_record(path: Path) -> EpisodeRecord:
    return read(path, EpisodeRecord, RECORD_SCHEMA)


DOCUMENT = json.loads(TEXT)
BROKEN: dict[str, str | bytes] = {
    "truncated": TEXT[: len(TEXT) // 2],
    "empty": "",
    "list": "[]",
    "no text": b"\xff\xfe\x00",
    "another schema": json.dumps({**DOCUMENT, "schema": 99}),
    "missing field": json.dumps({k: v for k, v in DOCUMENT.items() if k != "seed"}),
    "unknown field": json.dumps({**DOCUMENT, "colour": "red"}),
    "contradiction": json.dumps({**DOCUMENT, "final_stage": 1}),
    "odd changes": json.dumps({**DOCUMENT, "stage_changes": [[1, 2, 3]]}),
    "blank error": json.dumps({**DOCUMENT, "error": " \n", "success": False}),
    "nested": "[" * 100_000,
}


@pytest.mark.parametrize("kind", [*BROKEN, "folder"])
def test_broken_file_is_named(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "00003.json"
    if kind == "folder":
        path.mkdir()
    else:
        text = BROKEN[kind]
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(FileError, match=r"Cannot read .*00003\.json: "):
        read_record(path)


@pytest.mark.parametrize(
    ("field", "value", "found"),
    [
        ("seed", "not a number", "Expected `int`, got `str`"),
        ("success", 1, "Expected `bool`, got `int`"),
        ("instruction", [], "Expected `str`, got `array`"),
        ("error", 3, "Expected `str | null`, got `int`"),
        ("layout", None, "Expected `object`, got `null`"),
        ("layout", {"poses": "x"}, "Expected `object`, got `str`"),
        ("layout", {"poses": {"cube": [1.0]}}, "Expected `array` of length >= 7"),
        ("layout", {"variants": [1]}, "Expected `object`, got `array`"),
        ("stage_changes", [[1, "2"]], "Expected `int`, got `str`"),
        ("config", {"chunk": "x"}, "Expected `int | null`, got `str`"),
        ("versions", 3, "Expected `object`, got `int`"),
    ],
)
def test_wrong_type_is_refused_with_file_and_field(
    field: str, value: Any, found: str, tmp_path: Path
) -> None:
    path = tmp_path / "00003.json"
    path.write_text(json.dumps({**DOCUMENT, field: value}))
    with pytest.raises(FileError, match=rf"00003\.json: {re.escape(found)} - at `{field}"):
        read_record(path)


def test_targets_come_back_to_the_bit_and_float32_takes_half_the_room() -> None:
    double = np.random.default_rng(0).standard_normal((40, 16))
    single = double.astype(np.float32)
    for sent in (single, double, np.zeros((0, 16))):
        assert np.array_equal(unpack_targets(pack_targets(sent), len(sent)), sent)
    assert len(pack_targets(single)) < 0.6 * len(pack_targets(double))
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
