import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from duobench.data import DataSet, Recording
from duobench.data.schema import INFO_KEY
from duobench.data.stream import BATCH_ROWS, recover
from duobench.errors import DataError
from tests.data.tools import TASK, equal, play, recorded, recorder

CHILD = """
import sys
from pathlib import Path
from tests.data.tools import play, recorder
env = recorder(Path(sys.argv[1]), horizon=100_000)
print("ready", flush=True)
play(env, steps=20)
play(env, steps=100_000, seed=1)
"""


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Recording]:
    folder = tmp_path_factory.mktemp("data")
    return folder, recorded(folder)


def test_reading_gives_what_was_written(tmp_path: Path, example: tuple[Path, Recording]) -> None:
    path = tmp_path / "copy.parquet"
    example[1].write(path)
    assert equal(Recording.read(path), example[1])
    assert Recording.read_info(path) == example[1].info
    first = path.read_bytes()
    example[1].write(path)
    assert path.read_bytes() == first


def test_it_is_plain_parquet(example: tuple[Path, Recording]) -> None:
    (path,) = DataSet.open(example[0]).episodes()
    table = pq.read_table(path)
    assert table.column("agent_pos").type == pa.list_(pa.float32(), 16)
    assert table.column("action")[-1].as_py() is None
    assert table.column("state")[-1].as_py() is not None


def _cut(data: bytes) -> bytes:
    return data[: len(data) // 2]


def _flip(data: bytes) -> bytes:
    middle = len(data) // 3
    return (
        data[:middle]
        + bytes(255 - byte for byte in data[middle : middle + 64])
        + data[middle + 64 :]
    )


@pytest.mark.parametrize("damage", [_cut, _flip, lambda _: b"", lambda _: b"PAR1" * 100])
def test_a_damaged_file_is_named_and_the_rest_stays_usable(
    tmp_path: Path, example: tuple[Path, Recording], damage
) -> None:
    data = DataSet.open(tmp_path)
    for name in ("a", "b"):
        example[1].write(data.episode(TASK, name))
    bad = data.episode(TASK, "a")
    bad.write_bytes(damage(bad.read_bytes()))
    with pytest.raises(DataError, match=r"a\.parquet"):
        Recording.read(bad)
    assert equal(Recording.read(data.episode(TASK, "b")), example[1])


def test_foreign_and_newer_files_are_refused(
    tmp_path: Path, example: tuple[Path, Recording]
) -> None:
    path = tmp_path / "x.parquet"
    pq.write_table(pa.table({"a": [1, 2]}), path)
    with pytest.raises(DataError, match="no recording of DuoBench"):
        Recording.read(path)
    (good,) = DataSet.open(example[0]).episodes()
    table = pq.read_table(good)
    text = table.schema.metadata[INFO_KEY]
    newer = text.replace(b'"schema": 1', b'"schema": 2')
    assert newer != text
    pq.write_table(table.replace_schema_metadata({INFO_KEY: newer}), path)
    with pytest.raises(DataError, match="Schema 2; this version reads 1"):
        Recording.read(path)
    pq.write_table(table.drop_columns(["sent"]), path)
    with pytest.raises(DataError, match="missing: sent"):
        Recording.read(path)
    wrong = table.set_column(0, "time", pa.array(["x"] * table.num_rows))
    pq.write_table(wrong, path)
    with pytest.raises(DataError, match="'time' has type string"):
        Recording.read(path)
    holes = table.set_column(0, "time", pa.array([None] * table.num_rows, pa.float64()))
    pq.write_table(holes, path)
    with pytest.raises(DataError, match="'time' lacks values"):
        Recording.read(path)


def test_columns_of_different_length_are_refused(example: tuple[Path, Recording]) -> None:
    with pytest.raises(DataError, match="'reward' has shape"):
        replace(example[1], reward=example[1].reward[:-1])


@pytest.mark.parametrize("content", ["{}", "nothing", '{"schema": 9}'])
def test_a_folder_of_another_kind_is_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "dataset.json").write_text(content)
    with pytest.raises(DataError, match=r"dataset\.json"):
        DataSet.open(tmp_path)


def test_folders_that_hold_something_else_are_left_alone(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="holds no data set"):
        DataSet.open(tmp_path / "new", create=False)
    (tmp_path / "thesis.tex").write_text("...")
    with pytest.raises(DataError, match="not empty"):
        DataSet.open(tmp_path)


def test_what_is_left_of_a_stream_is_recovered_up_to_its_last_whole_row(
    tmp_path: Path,
) -> None:
    expected = recorded(tmp_path / "whole", steps=60, horizon=80)
    env = recorder(tmp_path / "left", horizon=80)
    play(env, steps=60)
    data = DataSet.open(tmp_path / "left")
    (partial,) = data.partials()
    whole = partial.read_bytes()
    kept = set()
    for length in (*range(len(whole) - 3000, len(whole), 300), len(whole)):
        partial.write_bytes(whole[:length])
        rows = recover(partial)
        kept.add(len(rows))
        np.testing.assert_array_equal(rows.sent, expected.sent[: len(rows)])
        np.testing.assert_array_equal(rows.state, expected.state[: len(rows) + 1])
        assert rows.info.outcome is not None
        assert rows.info.outcome.cut
    assert max(kept) >= 60 - BATCH_ROWS
    for other in (
        b"",
        whole[:7],
        whole[:100],
        b"\xff" * 100,
        whole.replace(b'"action": 1', b'"action":-1'),
    ):
        partial.write_bytes(other)
        with pytest.raises(DataError, match=r"00000\.part"):
            recover(partial)
    env.close()


def test_a_killed_recording_loses_half_a_second_and_no_finished_episode(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for attempt in range(3):
        folder = tmp_path / str(attempt)
        root = Path(__file__).parents[2]
        child = subprocess.Popen(
            [sys.executable, "-c", CHILD, str(folder)],
            cwd=root,
            env={**os.environ, "PYTHONPATH": f"{root / 'src'}:{root}"},
            stdout=subprocess.PIPE,
        )
        assert child.stdout is not None
        child.stdout.readline()
        data = DataSet(folder)
        deadline = time.monotonic() + 60
        while len(data.episodes()) < 1 and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(float(rng.uniform(0.1, 0.5)))
        child.send_signal(signal.SIGKILL)
        child.communicate()
        assert len(Recording.read(data.episode(TASK, "00000"))) == 20
        recovered = []
        for partial in data.partials():
            with suppress(DataError):  # killed before its first rows were written
                recovered.append(Recording.read(data.recover(partial)))
        assert all(rows.info.outcome and rows.info.outcome.cut for rows in recovered)
        assert all(len(rows) >= BATCH_ROWS - 1 for rows in recovered)
