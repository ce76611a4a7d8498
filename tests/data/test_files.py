import hashlib
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from duobench.core.errors import DataError, FileError, OtherRunError, OutputError
from duobench.data import Actor, DataSet, Recording, stream
from duobench.data.schema import COLUMNS, INFO_KEY
from duobench.data.stream import BATCH_ROWS, recover
from tests.data.tools import TASK, child_of, ended, equal, only, play, recorded, recorder, room
from tests.envs.tools import wave
from tests.evaluation.processes import wait_until


def record(folder: Path) -> None:
    """Record one short episode and one that never ends, until somebody kills this process."""
    env = recorder(folder, horizon=100_000)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    play(env, steps=20)
    play(env, steps=100_000, seed=1)


def test_reading_gives_what_was_written(tmp_path: Path, example: Recording) -> None:
    path = tmp_path / "copy.parquet"
    example.write(path)
    assert equal(Recording.read(path), example)
    assert Recording.read_info(path) == example.info
    first = path.read_bytes()
    example.write(path)
    assert path.read_bytes() == first


def test_it_is_plain_parquet(original: DataSet) -> None:
    table = pq.read_table(original.episodes()[0])
    assert table.column("agent_pos").type == pa.list_(pa.float32(), 16)
    assert table.column("action")[-1].as_py() is None
    assert table.column("state")[-1].as_py() is not None


@pytest.mark.skipif(int(pa.__version__.split(".")[0]) < 26, reason="reads none that is missing")
def test_lists_of_fixed_size_are_read_as_before(tmp_path: Path, example: Recording) -> None:
    """Recordings of before had them, also where the last row is missing."""
    table = pq.read_table(written(tmp_path, example))
    for name in ("action", "sent"):
        number, kind = table.column_names.index(name), pa.list_(pa.float64(), 16)
        table = table.set_column(number, name, pa.array(table.column(name).to_pylist(), kind))
    pq.write_table(table, tmp_path / "old.parquet")
    assert equal(Recording.read(tmp_path / "old.parquet"), example)


def test_an_episode_without_actions_says_how_wide_they_are(
    tmp_path: Path, example: Recording
) -> None:
    """In rows that are there, since Arrow before 26 reads no list of fixed size that is missing."""
    rows = {column.name: slice(0 if column.of_action else 1) for column in COLUMNS}
    first = {name: getattr(example, name)[kept] for name, kept in rows.items()}
    empty = replace(example, **first)
    path = written(tmp_path, empty)
    assert equal(Recording.read(path), empty)
    actions = pq.read_table(path).column("action")
    assert actions.null_count == 0
    assert actions.to_pylist() == [[None] * 16]


def test_lists_of_which_none_is_there_are_refused(tmp_path: Path, example: Recording) -> None:
    table = pq.read_table(written(tmp_path, example)).slice(0, 1)
    number = table.column_names.index("action")
    lists = pa.array([None], pa.list_(pa.float64()))
    pq.write_table(table.set_column(number, "action", lists), tmp_path / "none.parquet")
    with pytest.raises(DataError, match=r"none\.parquet: Lists without any row"):
        Recording.read(tmp_path / "none.parquet")


def written(folder: Path, recording: Recording) -> Path:
    path = folder / "written.parquet"
    recording.write(path)
    return path


def flip_third(content: bytes) -> bytes:
    third = len(content) // 3
    flipped = bytes(255 - byte for byte in content[third : third + 64])
    return content[:third] + flipped + content[third + 64 :]


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[: len(content) // 2],
        flip_third,
        lambda _: b"",
        lambda _: b"PAR1" * 100,
    ],
)
def test_a_damaged_file_is_named_and_the_rest_stays_usable(
    data: DataSet, example: Recording, damage: Callable[[bytes], bytes]
) -> None:
    good, bad, *_ = data.episodes()
    bad.write_bytes(damage(bad.read_bytes()))
    with pytest.raises(DataError, match=bad.name):
        Recording.read(bad)
    assert equal(Recording.read(good), example)


def changed(old: bytes, new: bytes, *, is_signed: bool = True) -> Callable[[pa.Table], pa.Table]:
    """What a file says of its episode is something else, with a checksum that belongs to it."""

    def change(table: pa.Table) -> pa.Table:
        metadata = dict(table.schema.metadata)
        assert old in metadata[INFO_KEY]
        metadata[INFO_KEY] = metadata[INFO_KEY].replace(old, new)
        if is_signed:
            checksum = hashlib.sha256(metadata[INFO_KEY]).hexdigest()
            metadata[INFO_KEY + b".sha256"] = checksum.encode()
        return table.replace_schema_metadata(metadata)

    return change


def lists_of_action(kind: pa.DataType, *, first: int) -> Callable[[pa.Table], pa.Table]:
    """The actions in lists of another kind, of which the first holds only so many numbers."""

    def change(table: pa.Table) -> pa.Table:
        number = table.column_names.index("action")
        head, *others = table.column("action").to_pylist()
        return table.set_column(number, "action", pa.array([head[:first], *others], kind))

    return change


def without_numbers(kind: pa.DataType, value: object) -> Callable[[pa.Table], pa.Table]:
    return lambda table: table.set_column(0, "time", pa.array([value] * table.num_rows, kind))


WHOLE = (Recording.read,)
BOTH = (Recording.read, Recording.read_info)


@pytest.mark.parametrize(
    ("change", "message", "readers"),
    [
        (lambda _: pa.table({"a": [1, 2]}), "no recording of DuoBench", BOTH),
        (changed(b'"schema": 6', b'"schema": 5'), "Schema 5; this version reads 6", BOTH),
        (changed(b'"schema": 6', b'"schema": 7'), "Schema 7; this version reads 6", BOTH),
        (
            changed(b'"look": "default"', b'"look": "neon"'),
            r"x\.parquet.*Unknown look 'neon'",
            BOTH,
        ),
        (changed(b"default", b"DEFAULT", is_signed=False), "checksum is another one", BOTH),
        (lambda table: table.drop_columns(["sent"]), "missing: sent", WHOLE),
        (without_numbers(pa.string(), "x"), "'time' has type string", WHOLE),
        (without_numbers(pa.float64(), None), "'time' lacks values", WHOLE),
        (lists_of_action(pa.list_(pa.float64()), first=5), "Rows have 5 to 16 numbers", WHOLE),
        (lists_of_action(pa.list_(pa.float32()), first=16), "has type list<.*: float>", WHOLE),
    ],
)
def test_foreign_files_and_other_schemas_are_refused(
    tmp_path: Path,
    original: DataSet,
    change: Callable[[pa.Table], pa.Table],
    message: str,
    readers: tuple[Callable[[Path], object], ...],
) -> None:
    path = tmp_path / "x.parquet"
    pq.write_table(change(pq.read_table(original.episodes()[0])), path)
    for read in readers:
        with pytest.raises(DataError, match=message):
            read(path)


@pytest.mark.parametrize(
    ("name", "content", "error", "message"),
    [
        *(
            ("dataset.json", content, FileError, r"dataset\.json")
            for content in ("{}", "nothing", '{"schema": 9}')
        ),
        ("thesis.tex", "...", OtherRunError, "not empty"),
    ],
)
def test_a_folder_of_another_kind_is_left_alone(
    tmp_path: Path, name: str, content: str, error: type[Exception], message: str
) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(error, match=message):
        DataSet.open(tmp_path)
    with pytest.raises(DataError, match="holds no data set"):
        DataSet.open(tmp_path / "new", create=False)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_what_is_left_of_a_stream_is_recovered_up_to_its_last_whole_row(tmp_path: Path) -> None:
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
        assert ended(rows).cut
    assert max(kept) >= 60 - BATCH_ROWS
    changed_sizes = whole.replace(b'"action": 1', b'"action":-1')
    for other in (b"", whole[:7], whole[:100], b"\xff" * 100, changed_sizes):
        partial.write_bytes(other)
        with pytest.raises(DataError, match=r"00000\.part"):
            recover(partial)
    env.close()


@pytest.mark.slow
def test_a_killed_recording_loses_half_a_second_and_no_finished_episode(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for attempt in range(3):
        data = DataSet(tmp_path / str(attempt))
        child = child_of(__name__, data.path)
        assert child.stdout is not None
        child.stdout.readline()
        wait_until(data.episodes, "the first episode")
        time.sleep(float(rng.uniform(0.1, 0.5)))
        child.send_signal(signal.SIGKILL)
        child.communicate()
        assert len(Recording.read(data.episode(TASK, "00000"))) == 20
        recovered = []
        for partial in data.partials():
            with suppress(DataError):  # killed before its first rows were written
                recovered.append(Recording.read(data.recover(partial)))
        assert all(ended(rows).cut for rows in recovered)
        assert all(len(rows) >= BATCH_ROWS - 1 for rows in recovered)


@pytest.mark.parametrize(
    "column",
    [
        {"agent_pos": np.zeros(41, np.float32)},
        {"reward": np.zeros(39)},
        {"state": np.zeros((41, 0))},
        {"action": np.zeros((40, 16), np.int64)},
    ],
)
def test_columns_that_could_not_be_read_again_are_refused(
    example: Recording, column: dict[str, np.ndarray]
) -> None:
    with pytest.raises(DataError, match=f"{next(iter(column))!r} has shape"):
        replace(example, **column)


def test_any_text_can_be_recorded(tmp_path: Path, example: Recording) -> None:
    strange = replace(example, info=replace(example.info, actor=Actor(name="P\udcff")))
    strange.write(tmp_path / "x.parquet")
    assert Recording.read_info(tmp_path / "x.parquet").actor.name == "P?"


def test_what_a_full_disk_interrupts_is_recovered_in_order(tmp_path: Path) -> None:
    expected = recorded(tmp_path / "whole", steps=60, horizon=80)
    env = recorder(tmp_path / "full", horizon=80)
    env.reset(seed=0)
    failures = 0
    for number in range(60):
        try:
            with room(40_000 if 20 <= number < 40 else -1):
                env.step(wave(number))
        except OutputError:
            failures += 1
    assert failures
    data = DataSet(tmp_path / "full")
    rows = recover(data.partials()[0])
    assert len(rows) >= 60 - BATCH_ROWS
    np.testing.assert_array_equal(rows.state, expected.state[: len(rows) + 1])
    np.testing.assert_array_equal(rows.sent[:20], expected.sent[:20])
    env.close()
    assert np.array_equal(Recording.read(data.episodes()[0]).state, expected.state)


def test_an_episode_that_cannot_be_written_is_recovered_whole(tmp_path: Path) -> None:
    env = recorder(tmp_path)
    seen = play(env, steps=7)
    with room(0), pytest.raises(OutputError, match=r"00000\.parquet"):
        env.finish()
    data = DataSet(tmp_path)
    assert not data.episodes()  # nothing but the head could be written
    play(env, steps=7)
    taken = data.episode(TASK, "00001")
    taken.mkdir()
    with pytest.raises(DataError, match="exists already"):
        env.finish()
    taken.rmdir()
    rows = Recording.read(data.recover(data.partial(TASK, "00001")))
    np.testing.assert_array_equal(rows.sent, [step["sent"] for step in seen])
    env.close()


def test_an_episode_is_not_recovered_while_it_is_recorded(tmp_path: Path) -> None:
    env = recorder(tmp_path)
    play(env, steps=30)
    data = DataSet(tmp_path)
    with pytest.raises(OutputError, match=r"Another process is writing into .*00000\.part"):
        data.recover(data.partials()[0])
    env.close()
    assert len(only(tmp_path)) == 30


def test_what_was_left_is_not_thrown_away_for_another_episode(
    tmp_path: Path, example: Recording
) -> None:
    env = recorder(tmp_path)
    play(env, steps=30, seed=1)
    data = DataSet(tmp_path)
    (partial,) = data.partials()
    left, same = partial.read_bytes(), recover(partial)
    env.discard()
    partial.write_bytes(left)
    example.write(data.episode(TASK, "00000"))
    with pytest.raises(DataError, match="is another episode"):
        data.recover(partial)
    assert partial.exists()
    same.write(data.episode(TASK, "00000"))
    data.recover(partial)
    assert not partial.exists()
    env.close()


def test_no_recording_overwrites_what_was_put_in_its_place(
    tmp_path: Path, example: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, env = DataSet(tmp_path), recorder(tmp_path)
    play(env, steps=3)
    example.write(data.episode(TASK, "00000"))
    with pytest.raises(DataError, match="never overwritten"):
        env.finish()
    assert len(recover(data.partial(TASK, "00000"))) == 3
    # Another process finishes an episode just before this one begins one of that name.
    taken = data.episode(TASK, "00001")
    monkeypatch.setattr(stream, "make_folder", lambda _: example.write(taken))
    env.reset(seed=0)
    monkeypatch.undo()
    env.close()
    assert [path.stem for path in data.episodes()] == ["00000", "00001", "00002"]
    assert equal(Recording.read(taken), example)


@pytest.mark.parametrize(
    "head",
    [
        b"\xff" * 8,
        (3).to_bytes(8, "little") + b"[1]",
        (12).to_bytes(8, "little") + b'{"schema": 1}',
    ],
)
def test_a_hostile_head_is_named(tmp_path: Path, head: bytes) -> None:
    path = tmp_path / "x.part"
    path.write_bytes(head + b"\0" * 1000)
    for read in (recover, stream.read_left):
        with pytest.raises(DataError, match=r"x\.part"):
            read(path)


@pytest.mark.parametrize("size", [-1, 0, 2**27, 2**62, 10**400])
def test_hostile_sizes_cost_nothing(tmp_path: Path, size: int) -> None:
    env = recorder(tmp_path)
    play(env, steps=20)
    (partial,) = DataSet(tmp_path).partials()
    data = partial.read_bytes()
    end = 8 + int.from_bytes(data[:8], "little")
    text = data[8:end].replace(b'"action": 16', b'"action": %d' % size)
    assert text != data[8:end]
    other = tmp_path / "x.part"
    other.write_bytes(len(text).to_bytes(8, "little") + text + data[end:])
    with pytest.raises(DataError):
        recover(other)
    env.close()


def test_what_an_earlier_version_left_is_recovered(tmp_path: Path) -> None:
    """Its rows did not say who led."""
    env = recorder(tmp_path)
    play(env, steps=20)
    (partial,) = DataSet(tmp_path).partials()
    now, (_, rows) = recover(partial), stream.read_left(partial)
    data = partial.read_bytes()
    head = data[8 : 8 + int.from_bytes(data[:8], "little")]
    text = head.replace(b',\n  "has_leader": true', b"")
    assert text != head
    fields = [(name, rows.dtype[name]) for name in rows.dtype.names or () if name != "leader"]
    old = np.zeros(len(rows), np.dtype(fields, align=True))
    for name in old.dtype.names or ():
        old[name] = rows[name]
    other = tmp_path / "x.part"
    other.write_bytes(len(text).to_bytes(8, "little") + text + old.tobytes())
    assert equal(recover(other), now)
    env.close()


if __name__ == "__main__":
    record(Path(sys.argv[1]))
