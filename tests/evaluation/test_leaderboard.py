"""A leaderboard of real bundles: verified once, refused with a reason, never trusted."""

import hashlib
import json
import shutil
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.core.errors import EvaluationError
from duobench.core.files import CHECKSUM, checksum, zipped
from duobench.data.processes import Progress
from duobench.evaluation.replay import leaderboard
from duobench.evaluation.replay.leaderboard import make_leaderboard
from duobench.results import leaderboard as results_leaderboard
from duobench.results.bundle import write_bundle
from duobench.results.folder import RunFolder
from duobench.results.leaderboard import DOCUMENT, VERDICTS, Board
from duobench.results.run import WHOLE
from duobench.results.salt import ROUNDS, make_salt, read_salt
from tests.evaluation import toy_tasks
from tests.evaluation.forging import Document, copied, rewritten

RECORD = "records/bin_sort/hold.sim.none.default/00000.json"


def play(
    path: Path,
    policy: str,
    tasks: str = "bin_sort",
    episodes: int = 1,
    salt: Path | None = None,
) -> RunFolder:
    words = ["--tasks", tasks, "--episodes", str(episodes), "--videos", "0", "--workers", "0"]
    words += ["--salt", str(salt)] if salt else []
    main(["eval", "--policy", policy, "--out", str(path), *words])
    return RunFolder(path)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, RunFolder]:
    folder = tmp_path_factory.mktemp("runs")
    return {name: play(folder / name, name) for name in ("hold", "random")}


@pytest.fixture
def folder(runs: dict[str, RunFolder], tmp_path: Path) -> Path:
    for name, run in runs.items():
        write_bundle(run, tmp_path / "bundles" / f"{name}.duobench.zip")
    return tmp_path / "bundles"


def made(folder: Path, out: Path) -> tuple[Board, dict[str, int]]:
    """The leaderboard, and how many episodes were verified of which bundles."""
    episodes: dict[str, int] = {}
    board, page = make_leaderboard(
        folder, out, started=lambda name: lambda done, _total: episodes.update({name: done})
    )
    assert page.is_file()
    return board, episodes


def contents(folder: Path) -> dict[str, bytes]:
    files = filter(Path.is_file, folder.rglob("*"))
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def changed(parts: dict[str, bytes], name: str, edit: Callable[[Document], None]) -> None:
    """Change a document of a bundle, and every checksum that would tell."""
    document = json.loads(parts[name])
    edit(document)
    parts[name] = json.dumps(document | {CHECKSUM: checksum(document)}).encode()
    if name != "manifest.json":
        digest = hashlib.sha256(parts[name]).hexdigest()
        changed(parts, "manifest.json", lambda manifest: manifest["parts"].update({name: digest}))


def forged(run: RunFolder, folder: Path, edit: Callable[[Document], None]) -> None:
    """Put a bundle of a forged copy of a run into a folder."""
    copy = copied(run, folder.parent / "forged")
    rewritten(copy.file(RECORD), edit)
    write_bundle(copy, folder / "forged.duobench.zip")


def reason(board: Board, name: str) -> str:
    (found,) = (one.reason for one in board.refused if one.file == name)
    return found


def test_every_bundle_is_verified_once(folder, tmp_path):
    out = tmp_path / "site"
    board, played = made(folder, out)
    assert played == {"hold.duobench.zip": 1, "random.duobench.zip": 1}
    assert [one.name for one in board.partial] == ["hold", "random"]
    assert board.entries[0].verdicts["exact"] == 1
    before = contents(out)
    again, played = made(folder, out)
    assert (again, played) == (board, {})
    assert contents(out) == before


def test_bytes_do_not_depend_on_what_was_there_before(folder, tmp_path):
    made(folder, tmp_path / "all at once")
    last = folder / "random.duobench.zip"
    last.rename(tmp_path / last.name)
    shutil.copy(folder / "hold.duobench.zip", folder / "OTHER.ZIP")
    board, _ = made(folder, tmp_path / "one by one")
    assert [each.file for each in board.refused] == ["hold.duobench.zip"]  # the same run
    (folder / "OTHER.ZIP").unlink()
    (tmp_path / last.name).rename(last)
    _, played = made(folder, tmp_path / "one by one")
    assert played == {last.name: 1}
    assert contents(tmp_path / "one by one") == contents(tmp_path / "all at once")


def test_what_an_interrupted_call_has_verified_is_kept(folder, tmp_path):
    def interrupt(name: str) -> Progress:
        if name.startswith("random"):
            raise KeyboardInterrupt
        return lambda _done, _total: None

    with pytest.raises(KeyboardInterrupt):
        make_leaderboard(folder, tmp_path / "site", started=interrupt)
    assert not (tmp_path / "site" / DOCUMENT).exists()
    assert made(folder, tmp_path / "site")[1] == {"random.duobench.zip": 1}


def test_another_version_verifies_anew(folder, tmp_path, monkeypatch):
    made(folder, tmp_path / "site")
    monkeypatch.setattr(leaderboard, "SUITE_VERSION", "another")
    assert len(made(folder, tmp_path / "site")[1]) == 2


def test_a_verdict_that_was_edited_or_damaged_is_not_believed(folder, tmp_path):
    out = tmp_path / "site"
    made(folder, out)
    first, second = sorted((out / VERDICTS).glob("*.json"))
    first.write_text(first.read_text().replace('"exact": 1', '"exact": 100'))
    second.write_bytes(second.read_bytes()[:50])
    assert len(made(folder, out)[1]) == 2


def test_claims_that_are_not_earned_are_refused(runs, folder, tmp_path):
    def winning(record: Document) -> None:
        stage = record["max_stage"]
        record.update(success=True, success_at_end=True, final_stage=stage)
        record.update(stage_changes=[[10 * k, k] for k in range(1, stage + 1)])

    forged(runs["hold"], folder, winning)
    board, _ = made(folder, tmp_path / "site")
    assert reason(board, "forged.duobench.zip").startswith("Contradicted. bin_sort, episode 0: ")
    assert len(board.entries) == 2
    page = (tmp_path / "site" / "index.html").read_text()
    assert page.index('<h2 id="refused">') < page.index("forged.duobench.zip")
    again, played = made(folder, tmp_path / "site")
    assert (again, played) == (board, {})


def test_what_cannot_be_played_again_must_have_failed(runs, folder, tmp_path):
    def edit(record: Document) -> None:
        record.update(sent=None, clipped=None)

    forged(play(tmp_path / "two", "hold", episodes=2), folder, edit)
    board, _ = made(folder, tmp_path / "site")
    assert "cannot be verified, though no error ended it" in reason(board, "forged.duobench.zip")
    shutil.rmtree(folder.parent / "forged")
    forged(runs["hold"], folder, edit)
    board, _ = made(folder, tmp_path / "site")
    assert "Nothing in it can be verified" in reason(board, "forged.duobench.zip")


def test_hostile_and_damaged_archives_are_refused(folder, tmp_path):
    whole = (folder / "hold.duobench.zip").read_bytes()
    for name, content in (
        ("cut", whole[:2000]),
        ("empty", b""),
        ("text", b"<script>alert(1)</script>"),
        ("flipped", whole.replace(b"records/", b"../../x/")),
        ("twin", whole),
    ):
        (folder / f"{name}.duobench.zip").write_bytes(content)
    (folder / "link.duobench.zip").symlink_to("/dev/zero")
    (folder / "folder.duobench.zip").mkdir()
    (folder / "notes.txt").write_text("mine")
    board, _ = made(folder, tmp_path / "site")
    refused = [one.file.removesuffix(".duobench.zip") for one in board.refused]
    assert refused == ["cut", "empty", "flipped", "text", "twin"]
    assert "No bundle has a part '../../x/" in reason(board, "flipped.duobench.zip")
    assert reason(board, "twin.duobench.zip") == "It holds the same run as hold.duobench.zip."
    assert not any(str(tmp_path) in one.reason for one in board.refused)
    assert len(board.entries) == 2


def test_only_what_counts_is_verified_and_shown(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(results_leaderboard, "EPISODES", 1)
    for name in ("hold", "random"):
        (folder / f"{name}.duobench.zip").unlink()
    run = play(tmp_path / "two", "hold", episodes=2)
    rewritten(run.file(RECORD.replace("00000", "00001")), lambda record: record.update(steps=9))
    write_bundle(run, folder / "two.duobench.zip")
    board, played = made(folder, tmp_path / "site")
    assert (board.refused, played) == ((), {"two.duobench.zip": 1})
    assert board.entries[0].results.overall.episodes == 1
    rewritten(run.file(RECORD), lambda record: record.update(steps=9))
    write_bundle(run, folder / "two.duobench.zip")
    board, _ = made(folder, tmp_path / "site")
    assert "Contradicted" in reason(board, "two.duobench.zip")


def test_same_run_in_another_archive_is_no_second_entry(runs, folder, tmp_path):
    packed, others = folder / "packed.duobench.zip", ["hold.duobench.zip", "random.duobench.zip"]
    with zipfile.ZipFile(folder / "hold.duobench.zip") as old, zipfile.ZipFile(packed, "w") as new:
        for entry in old.infolist():
            new.writestr(entry, old.read(entry), zipfile.ZIP_STORED)
    spaced = copied(runs["hold"], tmp_path / "spaced")
    spaced.file(RECORD).write_text(spaced.file(RECORD).read_text().replace('": ', '":  '))
    write_bundle(spaced, folder / "spaced.duobench.zip")
    board, played = made(folder, tmp_path / "site")
    for name in ("packed", "spaced"):
        twin = reason(board, f"{name}.duobench.zip")
        assert twin == "It holds the same run as hold.duobench.zip."
    assert sorted(played) == others


@pytest.mark.parametrize("part", ["run.json", "manifest.json"])
def test_no_copy_of_which_more_is_shown_takes_the_place_of_a_run(folder, tmp_path, part):
    def edit(document: Document) -> None:
        if part == "run.json":
            document["suite"]["shifts"].append({"axis": "look", "level": 1})
        else:
            document["commands"] = ["duobench eval --policy theirs"]

    with zipfile.ZipFile(folder / "hold.duobench.zip") as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    changed(parts, part, edit)
    if part == "run.json":  # the episode under the other shift
        changed(parts, "manifest.json", lambda manifest: manifest.update(missing=1))
    (folder / "a.duobench.zip").write_bytes(zipped(parts, zipfile.ZIP_DEFLATED))
    board, _ = made(folder, tmp_path / "site")
    assert "hold.duobench.zip" in {each.file for each in board.entries}


def test_bundles_under_other_names_and_foreign_archives_are_told(folder, tmp_path):
    (folder / "hold.duobench.zip").rename(folder / "hold.duobench (1).zip")
    with zipfile.ZipFile(folder / "photos.zip", "w") as archive:
        archive.writestr("a.jpg", b"a")
    board, _ = made(folder, tmp_path / "site")
    assert {each.file for each in board.entries} == {"hold.duobench (1).zip", "random.duobench.zip"}
    assert "No bundle has a part 'a.jpg'" in reason(board, "photos.zip")


def test_bundle_with_numbers_beyond_all_bounds_is_refused_and_no_other(folder, tmp_path):
    with zipfile.ZipFile(folder / "hold.duobench.zip") as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    changed(parts, "run.json", lambda document: document["suite"].update(episodes=2**63))
    (folder / "a.duobench.zip").write_bytes(zipped(parts, zipfile.ZIP_DEFLATED))
    board, _ = made(folder, tmp_path / "site")
    assert "ends before 9007199254740992" in reason(board, "a.duobench.zip")
    assert len(board.entries) == 2


def test_served_policies_are_listed_by_their_own_names(folder, tmp_path):
    entry = made(folder, tmp_path / "site")[0].entries[0]
    (candidate,) = entry.part.run.candidates
    metadata = replace(candidate.metadata, name="theirs")
    served = replace(candidate, policy="openpi", metadata=metadata)
    condition = replace(entry.part.condition, policy="openpi")
    part = replace(
        entry.part, run=replace(entry.part.run, candidates=(served,)), condition=condition
    )
    assert replace(entry, part=part).name == "theirs"


def test_what_was_begun_again_earns_no_place(folder, tmp_path):
    entry = made(folder, tmp_path / "site")[0].entries[0]
    overall = replace(
        entry.results.overall, episodes=100, successes=80, repeated=40, repeated_successes=35
    )
    part = replace(entry.part, results=replace(entry.results, overall=overall))
    assert replace(entry, part=part).standing[0] == pytest.approx(0.45)


def test_no_copy_takes_the_place_of_a_run(runs, folder, tmp_path):
    bare = copied(runs["hold"], tmp_path / "bare")
    shutil.rmtree(bare.path / "attempts")
    write_bundle(bare, folder / "a.duobench.zip")
    board, _ = made(folder, tmp_path / "site")
    unnoted = "of 1 episodes no attempt is on record"
    assert not board.refused
    assert {each.file[:-13]: unnoted in each.lacks for each in board.entries} == {
        "a": True,
        "hold": False,
        "random": False,
    }


def test_no_copy_takes_the_place_of_a_hosted_run(folder, tmp_path):
    salt = tmp_path / "salt"
    make_salt(salt)
    run = play(tmp_path / "hosted", "hold", salt=salt)
    theirs, copy = folder / "theirs.duobench.zip", folder / "a.duobench.zip"
    write_bundle(run, theirs)
    run.journal(WHOLE).write_text(run.journal(WHOLE).read_text().replace("hold --", "mine --"))
    write_bundle(run, copy)
    digest = hashlib.sha256(theirs.read_bytes()).hexdigest()
    (folder / ROUNDS).write_text(
        f'[[round]]\nname = "r"\ndate = 2026-09-01\nbundles = ["{digest}"]\n'
        f'salt_sha256 = "{read_salt(salt).sha256}"\n'
    )
    board, _ = made(folder, tmp_path / "site")
    assert copy.read_bytes() != theirs.read_bytes()
    assert not board.refused
    assert [each.file for each in board.entries if each.hosted] == ["theirs.duobench.zip"]


def test_run_is_no_twin_of_one_that_was_refused(runs, folder, tmp_path):
    spoilt = copied(runs["hold"], tmp_path / "spoilt")
    rewritten(spoilt.file(RECORD), lambda record: record.update(steps=9))
    for name in ("a", "b"):
        write_bundle(spoilt, folder / f"{name}.duobench.zip")
    board, _ = made(folder, tmp_path / "site")
    assert len(board.entries) == 2
    assert [reason(board, f"{name}.duobench.zip")[:12] for name in "ab"] == ["Contradicted"] * 2


def test_too_large_files_are_not_even_read(folder, tmp_path, monkeypatch):
    with (folder / "huge.duobench.zip").open("wb") as file:
        file.truncate(2**40)  # a file with a hole, which takes no room
    monkeypatch.setattr(leaderboard, "_entry", lambda *_: pytest.fail("it was read"))
    (folder / "hold.duobench.zip").unlink()
    (folder / "random.duobench.zip").unlink()
    board, _ = made(folder, tmp_path / "site")
    assert "larger than" in reason(board, "huge.duobench.zip")


def test_tasks_of_others_are_refused_and_not_imported(folder, tmp_path):
    run = play(tmp_path / "nod", "hold", toy_tasks.NOD_NAME)
    write_bundle(run, folder / "nod.duobench.zip")
    board, _ = made(folder, tmp_path / "site")
    assert reason(board, "nod.duobench.zip") == "It has a task that is none of the benchmark: nod."


def test_folder_without_a_bundle_is_said(tmp_path):
    with pytest.raises(EvaluationError, match=r"no file whose name ends in \.zip"):
        make_leaderboard(tmp_path, tmp_path / "site")
    assert not (tmp_path / "site").exists()
