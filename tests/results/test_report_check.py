"""What people read in the folder of a run is contradicted where its records give something else."""

import os
import random
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.core.errors import escaped
from duobench.results import figures
from duobench.results.folder import RunFolder
from duobench.results.pages import software
from duobench.results.report import check_report, read_parts, write_report
from duobench.tasks.shifts.shift import NO_SHIFT, Shift
from tests.results.samples import SORT, key, sample_folder, sample_records, sample_run

LOOK = Shift(axis="look", level=1)
SHAPES = ("plain", "policies", "shifts", "unfinished", "empty")
CONDITION = "conditions/mine.sim.none.default"


def made(path: Path, shape: str) -> RunFolder:
    """The folder of a run of one shape, with its report."""
    run = sample_run(shifts=(NO_SHIFT, LOOK) if shape == "shifts" else (NO_SHIFT,))
    if shape == "policies":
        run = replace(run, candidates=(run.candidate, replace(run.candidate, policy="a:b")))
    records = sample_records(run)
    folder = sample_folder(path, run, records[: {"unfinished": 5, "empty": 0}.get(shape)])
    with folder.writer() as journal:
        journal.start("duobench eval --policy mine", 1)
    write_report(folder)
    return folder


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, RunFolder]:
    return {shape: made(tmp_path_factory.mktemp("runs") / shape, shape) for shape in SHAPES}


@pytest.fixture
def copy(originals: dict[str, RunFolder], tmp_path: Path) -> Callable[[str], RunFolder]:
    def one(shape: str) -> RunFolder:
        shutil.copytree(originals[shape].path, tmp_path / shape)
        return RunFolder(tmp_path / shape)

    return one


def found(folder: RunFolder) -> list[str]:
    return check_report(folder, read_parts(folder))[0]


def edited(path: Path, pattern: str, new: str) -> None:
    text, count = re.subn(pattern, new, path.read_text(), count=1)
    assert count == 1
    path.write_text(text)


@pytest.mark.parametrize("shape", SHAPES)
def test_honest_report_is_that_of_its_records_and_nothing_is_written(
    originals: dict[str, RunFolder], shape: str
) -> None:
    folder = originals[shape]
    before = {path: path.stat().st_mtime_ns for path in folder.path.rglob("*")}
    assert check_report(folder, read_parts(folder)) == ([], [])
    assert {path: path.stat().st_mtime_ns for path in folder.path.rglob("*")} == before


def test_report_may_be_missing_or_a_part_of_it(copy: Callable[[str], RunFolder]) -> None:
    folder = copy("shifts")
    shutil.rmtree(folder.path / "conditions")
    assert found(folder) == []
    folder.page.unlink()
    assert found(folder) == []


def test_copy_without_its_journals_is_compared_in_numbers(
    copy: Callable[[str], RunFolder],
) -> None:
    folder = copy("plain")
    shutil.rmtree(folder.path / "attempts")
    assert check_report(folder, read_parts(folder)) == ([], ["index.html"])
    edited(folder.page, r"<dd>\d+\.\d %", "<dd>100.0 %")
    assert len(found(folder)) == 1


def test_videos_may_come_and_go(copy: Callable[[str], RunFolder]) -> None:
    folder = copy("plain")
    video = folder.video(key(folder, SORT.id, 0))
    video.parent.mkdir(parents=True)
    video.write_bytes(b"video")
    assert found(folder) == []  # added, and not on the page
    write_report(folder)
    assert "00000.webm" in folder.page.read_text()
    assert found(folder) == []
    video.unlink()
    assert found(folder) == []
    edited(folder.page, "00000.webm", "00001.webm")
    assert found(folder)


FORGERIES = {
    "summary": (
        "plain",
        "summary.json",
        r'"successes": \d+',
        '"successes": 99',
        r"summary\.json says “tasks lift successes 99”, its records give “tasks lift succ",
    ),
    "twice": (
        "plain",
        "summary.json",
        r'"successes": (\d+)',
        r'"successes": 99, "successes": \1',
        r"summary\.json says ",
    ),
    "added": ("plain", "summary.json", r'"schema"', '"success": 1, "schema"', "says “success 1”"),
    "name": ("plain", "summary.json", '"mine"', '"<b>mine"', 'says “policy "<b>mine"”, its rec'),
    "no JSON": ("plain", "summary.json", r"\{", "", "its records give"),
    "headline": (
        "plain",
        "index.html",
        r"<dd>\d+\.\d %",
        "<dd>100.0 %",
        r"index\.html says “Success 100\.0 %”, its records give “Success \d+\.\d %”; duobench rep",
    ),
    "sentence": (
        "plain",
        "index.html",
        "</header>",
        "<p>It is 100 %.</header>",
        "says “It is 100 %",
    ),
    "table": ("plain", "index.html", r'(<td class="right">)\d+\.\d<', r"\g<1>99.9<", "says “99.9”"),
    "figure": ("plain", "index.html", r">\d+\.\d %</text>", ">99.9 %</text>", "says “99.9 %”"),
    "bar": (
        "plain",
        "index.html",
        r'(<path d="M )\d+',
        r"\g<1>1",
        "differs in a figure",
    ),
    "style": ("plain", "index.html", "</style>", "dd::before{content:'9'}</style>", "says “dd::b"),
    "script": (
        "plain",
        "index.html",
        "</script>",
        "document.title='99 %'</script>",
        "says|differs",
    ),
    "time": ("plain", "index.html", "the episodes took is not known", "took 1 s", "took 1 s"),
    "hidden": ("plain", "index.html", "<main>", '<section id="times">99 %</section><main>', "99 %"),
    "svg": ("plain", "figures/stages.svg", r">\d+\.\d %<", ">99.9 %<", r"svg says “99\.9 %”"),
    "csv": (
        "policies",
        "table.csv",
        r",\d+,\d+,0\.\d+",
        ",4,4,1.000000",
        r"table\.csv says “.*4,4",
    ),
    "tex": ("policies", "table.tex", r"\d+\.\d \(", "99.9 (", r"table\.tex says “.*99\.9"),
    "md": ("policies", "table.md", r"\d+\.\d \(", "99.9 (", r"table\.md says “.*99\.9"),
    "p": ("policies", "comparison.json", r'"p": [\d.]+', '"p": 0.01', r"tests 0 p 0\.01”, its rec"),
    "compared": ("policies", "index.html", r"\d+\.\d</", "99.9</", "says “.*99.9"),
    "robustness": (
        "shifts",
        "robustness.json",
        r'"successes": \d+',
        '"successes": 99',
        "none succ",
    ),
    "levels": ("shifts", "index.html", r">\d+\.\d</a>", ">99.9</a>", r"says “99\.9 "),
    "condition": (
        "shifts",
        f"{CONDITION}/index.html",
        r"<dd>\d+\.\d %",
        "<dd>99 %",
        "Success 99 %",
    ),
    "its summary": (
        "shifts",
        f"{CONDITION}/summary.json",
        r'"errors": 0',
        '"errors": 5',
        rf"{CONDITION}/summary\.json says “.*errors 5”, its records give “.*errors 0”",
    ),
}


@pytest.mark.parametrize("forgery", FORGERIES)
def test_false_number_is_named(copy: Callable[[str], RunFolder], forgery: str) -> None:
    shape, name, pattern, new, words = FORGERIES[forgery]
    folder = copy(shape)
    edited(folder.file(name), pattern, new)
    (sentence,) = found(folder)
    assert re.search(words, sentence)


def test_report_that_is_older_than_its_records_is_told_until_it_is_written_anew(
    copy: Callable[[str], RunFolder],
) -> None:
    folder = copy("unfinished")
    run = folder.read_run()
    folder.write(replace(sample_records(run)[5], run=run.hash))
    files = ["figures/progress.svg", "figures/stages.svg", "index.html", "summary.json"]
    assert sorted(sentence.split()[0] for sentence in found(folder)) == files
    write_report(folder)
    assert found(folder) == []
    folder.discard(folder.finished(run)[0])
    assert found(folder)


def test_files_that_this_report_does_not_have_are_named(
    copy: Callable[[str], RunFolder], originals: dict[str, RunFolder]
) -> None:
    folder = copy("plain")
    for name in ("comparison.json", "table.csv", "index.html"):
        shutil.copy(originals["policies"].file(name), folder.file(name))
    shutil.copytree(originals["shifts"].file("conditions"), folder.file("conditions"))
    (folder.path / "notes.md").write_text("100 %")
    (folder.path / "figures" / "mine.svg").write_text("100 %")
    sentences = found(folder)
    assert sum("no part of this run's report; remove it" in each for each in sentences) == 2 + 8
    assert sum("duobench report writes it anew" in each for each in sentences) == 1


def of_other_software(folder: RunFolder) -> RunFolder:
    """Have every page say that another version has written it, in other words and another style."""
    for page in folder.path.rglob("*.html"):
        text = page.read_text().replace(software(), "DuoBench 0.9, Matplotlib 3")
        text = text.replace("</style>", "p{}</style>").replace(
            '<th scope="col">0 to 100 %</th>', ""
        )
        text = re.sub('<td>(<svg class="whisker".*?</svg>)?</td>', "", text, flags=re.DOTALL)
        page.write_text(text.replace("This run", "What was run"))
    for figure in folder.path.rglob("*.svg"):
        figure.write_text(figure.read_text().replace("svg", "svg "))
    return folder


OTHERS = {
    "summary": "says “tasks lift successes 99”, its records give “tasks lift successes",
    "headline": r"says “100\.0 %”, its records give “\d+\.\d %”",
    **dict.fromkeys(("table", "md", "levels"), r"says “99\.9”, its records give “\d+\.\d”"),
    "csv": r"table\.csv says “",
    "robustness": "none successes 99”, its records give “",
    "condition": r"says “99 %”, its records give “\d+\.\d %”",
}


@pytest.mark.parametrize("shape", ["plain", "policies", "shifts"])
def test_page_of_other_software_is_no_forgery(copy: Callable[[str], RunFolder], shape: str) -> None:
    folder = of_other_software(copy(shape))
    pages = {path.relative_to(folder.path).as_posix() for path in folder.path.rglob("*.html")}
    wrong, others = check_report(folder, read_parts(folder))
    assert (wrong, set(others)) == ([], pages)


@pytest.mark.parametrize("forgery", OTHERS)
def test_false_number_is_named_on_a_page_of_other_software(
    copy: Callable[[str], RunFolder], forgery: str
) -> None:
    shape, name, pattern, new, _ = FORGERIES[forgery]
    folder = of_other_software(copy(shape))
    edited(folder.file(name), pattern, new)
    (sentence,) = found(folder)
    assert re.search(OTHERS[forgery], sentence)


def test_page_of_other_software_without_its_numbers_is_named(
    copy: Callable[[str], RunFolder],
) -> None:
    folder = copy("plain")
    folder.page.write_text("<h1>100 %</h1>")
    (sentence,) = found(folder)
    assert re.match(r"index\.html says “nothing”, its records give “\d+\.\d %”;", sentence)


def test_damaged_files_are_told_in_a_sentence(
    copy: Callable[[str], RunFolder], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, rng = copy("plain"), random.Random(7)
    parts = read_parts(folder)
    svgs = figures.plots(parts[0].results)
    monkeypatch.setattr(figures, "plots", lambda _results: svgs)
    whole = {name: folder.file(name).read_bytes() for name in folder.report()}
    for turn in range(300):
        name = rng.choice(["index.html", "summary.json"])
        data = bytearray(whole[name])
        place = rng.randrange(len(data))
        match turn % 5:
            case 0:
                data[place] ^= 1 << rng.randrange(8)
            case 1:
                del data[place:]
            case 2:
                data[place : place + 100] = rng.randbytes(100)
            case 3:
                data[place:place] = rng.choice([b"[" * 10**5, b"<" * 10**5, b"9" * 5000, b"1e999"])
            case _:
                data = bytearray(
                    rng.choice([b"", b"null", b"[[]]", b"\xff" * 99, b"<table>" * 999])
                )
        folder.file(name).write_bytes(data)
        wrong = check_report(folder, parts)[0]
        assert all(sentence == escaped(sentence) and len(sentence) < 5000 for sentence in wrong)
        assert wrong or name == "summary.json"  # where a space more is none
        folder.file(name).write_bytes(whole[name])


def test_what_is_no_file_is_not_read(copy: Callable[[str], RunFolder]) -> None:
    folder = copy("plain")
    folder.page.unlink()
    folder.page.symlink_to("/dev/zero")
    folder.summary.unlink()
    os.mkfifo(folder.summary)
    assert found(folder) == []
