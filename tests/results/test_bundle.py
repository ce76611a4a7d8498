"""A bundle holds a run and its records, always as the same bytes; others are refused in words."""

import hashlib
import io
import os
import random
import shutil
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from duobench.core.errors import DuoBenchError, EvaluationError, FileError, OutputError
from duobench.core.files import encode
from duobench.results import bundle
from duobench.results.bundle import (
    BUNDLE_SCHEMA,
    Bundle,
    Manifest,
    open_source,
    read_source,
    write_bundle,
)
from duobench.results.folder import RunFolder
from duobench.results.report import write_report
from tests.results.samples import LIFT, key, sample_folder, sample_records, sample_run

FOLDER = "records/lift/mine.sim.none.default"
RECORD = f"{FOLDER}/00000.json"
LAST = "records/turn/mine.sim.none.default/00003.json"


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """A run with its report, to copy."""
    run = sample_run()
    folder = sample_folder(tmp_path_factory.mktemp("original") / "run", run, sample_records(run))
    with folder.writer() as journal:
        journal.start("duobench eval --policy mine", 1)
    folder.video(key(folder, LIFT.id, 0)).parent.mkdir(parents=True)
    folder.video(key(folder, LIFT.id, 0)).write_bytes(b"video")
    write_report(folder)
    return folder


@pytest.fixture
def folder(original: RunFolder, tmp_path: Path) -> RunFolder:
    """A copy of its own, to spoil."""
    shutil.copytree(original.path, tmp_path / "run")
    return RunFolder(tmp_path / "run")


@pytest.fixture
def path(folder: RunFolder, tmp_path: Path) -> Path:
    write_bundle(folder, tmp_path / "run.duobench.zip")
    return tmp_path / "run.duobench.zip"


@pytest.mark.parametrize("name", ["我的", "--", "mine v2"])
def test_bundle_of_a_policy_of_any_name_is_read(tmp_path: Path, name: str) -> None:
    run = sample_run(policy=name)
    folder = sample_folder(tmp_path / "run", run, sample_records(run))
    write_bundle(folder, tmp_path / "run.duobench.zip")
    assert read_source(tmp_path / "run.duobench.zip") == read_source(folder.path)


def test_bundle_that_another_tool_packed_again_is_read(path: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path / "parts")
    again = shutil.make_archive(str(tmp_path / "again"), "zip", tmp_path / "parts")
    with zipfile.ZipFile(again) as archive:
        assert "records/" in archive.namelist()
    assert read_source(Path(again)) == read_source(path)


def test_bundle_that_python_packed_again_without_types_of_files_is_read(path: Path) -> None:
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    again = path.with_name("again.zip")
    again.write_bytes(packed([(entry(name, 0o600), part) for name, part in parts.items()]))
    assert read_source(again) == read_source(path)


def test_bundle_of_a_run_that_begins_late_is_read(tmp_path: Path) -> None:
    run = sample_run(episodes=1, first_episode=5_000_000_000)
    folder = sample_folder(tmp_path / "run", run, sample_records(run))
    write_bundle(folder, tmp_path / "late.zip")
    assert read_source(tmp_path / "late.zip") == read_source(folder.path)


def test_archive_that_is_no_bundle_is_not_overwritten(folder: RunFolder, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "weights.npz", "w") as archive:
        archive.writestr("a.npy", b"mine")
    before = (tmp_path / "weights.npz").read_bytes()
    with pytest.raises(OutputError, match="is no bundle"):
        write_bundle(folder, tmp_path / "weights.npz")
    assert (tmp_path / "weights.npz").read_bytes() == before
    (tmp_path / "weights.npz").write_bytes(before.replace(b"PK\x01\x02", b"PK\x01\x09"))
    with pytest.raises(OutputError, match="is no bundle"):
        write_bundle(folder, tmp_path / "weights.npz")


def test_bundle_is_read_as_its_folder_is(folder: RunFolder, path: Path) -> None:
    assert read_source(path) == read_source(folder.path)
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    assert open_source(path).commands() == ["duobench eval --policy mine"]
    assert names[:3] == ["manifest.json", "run.json", RECORD]
    assert len(names) == 2 + 12
    assert write_bundle(open_source(path), path.with_name("again.zip")).missing == 0
    assert path.with_name("again.zip").read_bytes() == path.read_bytes()


def test_bytes_depend_neither_on_the_clock_nor_on_the_order_of_files(
    path: Path, tmp_path: Path
) -> None:
    other = sample_folder(tmp_path / "other", sample_run(), sample_records(sample_run())[::-1])
    with other.writer() as journal:
        journal.start("duobench eval --policy mine", 8)
    for record in other.path.rglob("*.json"):
        os.utime(record, (10**9, 10**9))
    write_bundle(other, tmp_path / "other.zip")
    assert (tmp_path / "other.zip").read_bytes() == path.read_bytes()


def test_unfinished_run_says_so(tmp_path: Path) -> None:
    run = sample_run()
    folder = sample_folder(tmp_path / "run", run, sample_records(run)[:5])
    assert write_bundle(folder, tmp_path / "part.zip").missing == 7
    assert Bundle(tmp_path / "part.zip").manifest.missing == 7
    assert read_source(tmp_path / "part.zip") == read_source(folder.path)


def test_damaged_run_is_not_bundled(folder: RunFolder, tmp_path: Path) -> None:
    record = folder.record(key(folder, LIFT.id, 0))
    record.write_text(record.read_text().replace("Do the lift.", "Do it."))
    with pytest.raises(FileError, match="checksum"):
        write_bundle(folder, tmp_path / "damaged.zip")
    assert not (tmp_path / "damaged.zip").exists()


def test_file_that_is_no_bundle_is_not_replaced(folder: RunFolder, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(OutputError, match=r"thesis\.tex is there and is no bundle"):
        write_bundle(folder, tmp_path / "thesis.tex")
    assert (tmp_path / "thesis.tex").read_text() == "precious"


def test_run_without_bounds_is_not_bundled(
    folder: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bundle, "MAX_PARTS", 12)
    with pytest.raises(EvaluationError, match="too large for a bundle"):
        write_bundle(folder, tmp_path / "large.zip")


# --- hostile archives ----------------------------------------------------------------------------

Entries = list[tuple[zipfile.ZipInfo, bytes]]


def entry(name: str, mode: int = stat.S_IFREG) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name)
    info.external_attr = mode << 16
    return info


def with_manifest(parts: dict[str, bytes], missing: int = 0) -> Entries:
    """An archive of parts whose manifest fits."""
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in parts.items()}
    made = Manifest(missing=missing, commands=(), attempts={}, parts=hashes)
    manifest = encode(made, BUNDLE_SCHEMA).encode()
    every = {"manifest.json": manifest, **parts}
    return [(entry(name), content) for name, content in every.items()]


def replaced(parts: dict[str, bytes]) -> Entries:
    """An archive whose manifest is that of the content before."""
    entries = with_manifest(parts)
    return [
        (info, content.replace(b"mine", b"ours") if info.filename == RECORD else content)
        for info, content in entries
    ]


Parts = dict[str, bytes]


def added(name: str) -> Callable[[Parts], Entries]:
    """An archive with a part more, which is a copy of a record."""
    return lambda parts: with_manifest({**parts, name: parts[RECORD]})


def beside(name: str) -> Callable[[Parts], Entries]:
    """An archive with a part more that its manifest does not list."""
    return lambda parts: [*with_manifest(parts), (entry(name), b"{}")]


HOSTILE: dict[str, tuple[Callable[[Parts], Entries], str]] = {
    "absolute": (added("/etc/passwd"), "no bundle has a part"),
    "parent": (added("records/../x.json"), "no bundle has a part"),
    "hidden": (added("records/lift/../00000.json"), "No bundle has"),
    "folder": (added("records/lift/"), "No bundle has"),
    "twice": (beside(RECORD), "default/00000.json twice"),
    "link": (lambda p: [*with_manifest(p)[:-1], (entry(LAST, stat.S_IFLNK), b"x")], "is a link"),
    "no manifest": (lambda p: with_manifest(p)[1:], "It has no manifest.json"),
    "no run": (lambda p: with_manifest({RECORD: p[RECORD]}), "or no run.json"),
    "unlisted": (beside(f"{FOLDER}/00009.json"), "00009"),
    "missing": (lambda p: with_manifest(p)[:-1], "is in its manifest or in it, not in both"),
    "changed": (replaced, "The SHA-256 of records/lift/.*00000.json is not that"),
    "too few": (
        lambda p: with_manifest({n: c for n, c in p.items() if n != RECORD}),
        "says that 0 records are missing, not 1",
    ),
    "foreign": (added(f"{FOLDER}/00007.json"), "of no episode of its run, .*00007.json"),
    "alias": (added(f"{FOLDER}/000000.json"), "of no episode of its run, .*000000.json"),
    "run": (lambda p: with_manifest({**p, "run.json": b"{}"}), "run.json: Schema None"),
}


def packed(entries: Entries) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for info, content in entries:
            archive.writestr(info, content, zipfile.ZIP_DEFLATED)
    return file.getvalue()


def parts_of(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist() if name != "manifest.json"}


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_bundle_is_refused(path: Path, kind: str) -> None:
    make, words = HOSTILE[kind]
    path.write_bytes(packed(make(parts_of(path))))
    with pytest.raises(FileError, match=rf"(?i)run\.duobench\.zip is no whole bundle: .*{words}"):
        read_source(path)


def test_name_with_a_zero_byte_is_refused(path: Path) -> None:
    content = packed(with_manifest({**parts_of(path), "run.json_.exe": b""}))
    path.write_bytes(content.replace(b"run.json_.exe", b"run.json\0.exe"))
    with pytest.raises(FileError, match="No bundle has a part"):
        Bundle(path)


def test_archive_that_the_tests_pack_is_taken(folder: RunFolder, path: Path) -> None:
    path.write_bytes(packed(with_manifest(parts_of(path))))
    assert read_source(path) == read_source(folder.path)


@pytest.mark.parametrize(
    ("bound", "most", "words"),
    [
        ("MAX_PARTS", 13, "more than 13 parts"),
        ("MAX_PART_BYTES", 500, "has more than 500 bytes"),
        ("MAX_BYTES", 20_000, "Its parts have more than 20000 bytes"),
        ("MAX_BYTES", 2_000, "It is larger than 2000 bytes"),
    ],
)
def test_everything_has_a_bound(
    path: Path, monkeypatch: pytest.MonkeyPatch, bound: str, most: int, words: str
) -> None:
    monkeypatch.setattr(bundle, bound, most)
    with pytest.raises(FileError, match=words):
        Bundle(path)


def test_part_that_unpacks_to_more_than_it_says_is_refused(path: Path) -> None:
    """Its entry says 100 bytes, in both places, and a hundred megabytes come out."""
    bomb = b"0" * 10**8
    content = packed([(entry("run.json"), bomb)])
    lying = content.replace(len(bomb).to_bytes(4, "little"), (100).to_bytes(4, "little"))
    assert lying != content
    path.write_bytes(lying)
    with pytest.raises(FileError, match=r"It is damaged|as many bytes"):
        Bundle(path)


def test_every_truncation_and_change_of_a_byte_is_refused(path: Path) -> None:
    whole = path.read_bytes()
    for length in range(0, len(whole), len(whole) // 40):
        path.write_bytes(whole[:length])
        with pytest.raises(FileError, match="is no whole bundle"):
            Bundle(path)
    for place in range(30, len(whole) // 2, 97):  # of the parts, not of what nobody reads
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x10]) + whole[place + 1 :])
        try:
            taken = read_source(path)
        except FileError:
            continue
        path.write_bytes(whole)
        assert taken == read_source(path)


def test_three_hundred_damages_are_refused_in_a_sentence_or_change_nothing(path: Path) -> None:
    whole, rng = path.read_bytes(), random.Random(3)
    expected = read_source(path)
    for turn in range(300):
        data = bytearray(whole)
        place, other = (rng.randrange(len(data)) for _ in range(2))
        match turn % 6:
            case 0:
                data[place] ^= 1 << rng.randrange(8)
            case 1:
                data[place : place + 100] = rng.randbytes(100)
            case 2:
                del data[place:]
            case 3:
                data[place : place + 50] = bytes(50)
            case 4:
                data[place], data[other] = data[other], data[place]
            case _:
                del data[place : place + rng.randrange(1, 100)]
        path.write_bytes(data)
        try:
            found = read_source(path)
        except DuoBenchError as error:
            told = str(error)
        else:
            told = "no whole bundle" if found == expected else ""
        assert "no whole bundle" in told
