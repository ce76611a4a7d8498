import json
import re
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.errors import EvaluationError, FileError
from duobench.files import encode, read, write
from duobench.results.records import RECORD_SCHEMA, EpisodeRecord, pack_targets, unpack_targets
from duobench.shifts.shift import Shift
from tests.results.samples import LIFT, sample_record, sample_records, sample_run

RECORDS = [*sample_records(sample_run()), sample_record(reached=(5,), error="boom\n")]


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: f"{record.task}-{record.episode}")
def test_record_survives_its_file(record: EpisodeRecord, tmp_path: Path) -> None:
    write(tmp_path / "r.json", encode(record, RECORD_SCHEMA))
    assert read_record(tmp_path / "r.json") == record
    assert (tmp_path / "r.json").read_text() == encode(record, RECORD_SCHEMA)


def test_text_has_a_field_a_line() -> None:
    text = encode(sample_record(), RECORD_SCHEMA)
    assert '\n  "stage_changes": [[10, 1], [20, 2], [30, 3]],\n' in text
    assert json.loads(text)["schema"] == RECORD_SCHEMA


@pytest.mark.parametrize(
    ("step", "stage"), [(0, 0), (9, 0), (10, 1), (19, 1), (20, 2), (30, 3), (90, 3)]
)
def test_stage_after_a_step_is_the_last_one_reached(step: int, stage: int) -> None:
    assert sample_record().stage_after(step) == stage


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


def test_progress_is_the_share_of_stages() -> None:
    assert sample_record(LIFT, reached=(7,)).progress == 0.5


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


def broken_texts() -> dict[str, str]:
    whole = encode(sample_record(), RECORD_SCHEMA)
    document = json.loads(whole)
    return {
        "truncated": whole[: len(whole) // 2],
        "empty": "",
        "list": "[]",
        "another schema": json.dumps({**document, "schema": 99}),
        "missing field": json.dumps({k: v for k, v in document.items() if k != "seed"}),
        "unknown field": json.dumps({**document, "colour": "red"}),
        "contradiction": json.dumps({**document, "final_stage": 1}),
        "odd changes": json.dumps({**document, "stage_changes": [[1, 2, 3]]}),
        "blank error": json.dumps({**document, "error": " \n", "success": False}),
        "nested": "[" * 100_000,
    }


@pytest.mark.parametrize("kind", broken_texts())
def test_broken_file_is_named(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "00003.json"
    path.write_text(broken_texts()[kind])
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
    path.write_text(
        json.dumps({**json.loads(encode(sample_record(), RECORD_SCHEMA)), field: value})
    )
    with pytest.raises(FileError, match=rf"00003\.json: {re.escape(found)} - at `{field}"):
        read_record(path)


def test_file_that_is_no_text_or_no_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "r.json").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "folder.json").mkdir()
    for name in ("r.json", "folder.json"):
        with pytest.raises(FileError, match=f"Cannot read .*{name}"):
            read_record(tmp_path / name)


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
