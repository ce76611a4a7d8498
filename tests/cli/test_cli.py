import ast
import html
import inspect
import io
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from duobench import __version__
from duobench.cli import main, program
from duobench.cli.program import COMMANDS, function_of, parsed
from duobench.cli.shared.console import console
from duobench.cli.shared.options import command_line, options_of
from duobench.core.files import decode, encode, locked
from duobench.data import DataSet
from duobench.policy import PolicyMetadata
from duobench.policy.baselines import HoldPolicy
from duobench.results.folder import RunFolder
from duobench.results.records import RECORD_SCHEMA, Record
from duobench.tasks import catalog
from duobench.world import looks
from tests.children import printed, ran
from tests.cli.conftest import Told, refusal
from tests.evaluation import toy_batches, toy_tasks
from tests.evaluation.processes import wait_until, workers
from tests.policy.serving.serving import Serve
from tests.quick_first import quick_first
from tests.results.outcomes import play
from tests.results.samples import key, without_times

ROOT = Path(__file__).parents[2]
EVAL = function_of("eval")
PATH = os.pathsep.join([str(ROOT / "src"), str(ROOT)])


BREAKS_ONCE = """
import sys
from pathlib import Path
from duobench.policy import HoldPolicy

class Mine(HoldPolicy):
    acts = 0

    def act(self, observation):
        self.acts += 1
        if self.acts == 3 and not Path("was_here").exists():
            Path("was_here").touch()
            sys.exit(3)
        return super().act(observation)
"""


def python(
    *words: str, folder: Path | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    return ran(*words, cwd=folder, env={**os.environ, "PYTHONPATH": PATH, **environment})


duobench = partial(python, "-P", "-m", "duobench")
"""Runs the command as it is installed: -P keeps the current folder off the path."""


@pytest.fixture
def evaluate(told: Told) -> Told:
    """Plays two small tasks, one episode of each without a video; what it printed."""
    small_ones = [toy_tasks.WAVE_NAME, toy_tasks.NOD_NAME]
    words = ["--policy", "random", "--tasks", *small_ones, "--workers", "0"]
    return partial(told, "eval", *words, "--episodes", "1", "--videos", "0", "--out")


def test_eval_leaves_what_it_says_and_exits_well(tmp_path: Path, evaluate: Told) -> None:
    run = tmp_path / "run"
    out = evaluate(run, "--episodes", "2", "--first-episode", "1")
    for words in ("4 of 4 episodes", "All tasks", f"Report: {run / 'index.html'}"):
        assert words in out
    summary = json.loads((run / "summary.json").read_text())
    assert summary["first_episode"] == 1
    assert summary["tasks"]["nod"]["episodes"] == 2
    names = [path.name for path in sorted((run / "records" / "wave").glob("*/*"))]
    assert names == ["00001.json", "00002.json"]


class LearnedWithHands(HoldPolicy):
    """Says with which gripper it learned."""

    metadata = PolicyMetadata(name="learned", cameras=(), robot="franka_hand")


def test_a_policy_plays_with_another_gripper_and_is_said_to(tmp_path: Path, evaluate: Told) -> None:
    words = "The policy learned with franka_hand, and plays with the paper's gripper and mount."
    run = tmp_path / "run"
    learned = ("--policy", f"{__name__}:LearnedWithHands")
    said = " ".join(evaluate(run, *learned).split())
    assert said.count(words) == 2, "when it begins, and below the table"
    assert words.replace("'", "&#39;") in (run / "index.html").read_text()
    assert "learned with" not in evaluate(tmp_path / "own", *learned, "--gripper", "franka_hand")
    assert "learned with" not in evaluate(tmp_path / "random")


def test_report_builds_the_page_anew(tmp_path: Path, evaluate: Told, told: Told) -> None:
    table = evaluate(tmp_path / "run").partition("Task")[2]
    page = tmp_path / "run" / "index.html"
    before = page.read_bytes()
    page.unlink()
    assert told("report", tmp_path / "run").partition("Task")[2] == table
    assert page.read_bytes() == before


@pytest.mark.slow
def test_report_makes_videos_once(tmp_path: Path, evaluate: Told, told: Told) -> None:
    run = tmp_path / "run"
    evaluate(run, "--episodes", "2")
    assert "1 video made\n" in told("report", run, "--import-tasks", "--videos", "nod:1")
    assert 'src="videos/nod/random.sim.none.default/00001.webm"' in (run / "index.html").read_text()
    out = told("report", run, "--import-tasks", "--videos", "all")
    assert "4 of 4 videos" in out
    assert "3 videos made, 1 there before" in out


def test_videos_of_failures_that_there_are_not(tmp_path: Path, told: Told) -> None:
    play(tmp_path / "run", {"sort": [3, 3]})
    out = told("report", tmp_path / "run", "--videos", "failures")
    assert "No video is made: failures chooses none of the episodes.\nReport: " in out


def test_video_that_cannot_be_made_is_told(
    tmp_path: Path, evaluate: Told, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    evaluate(run)
    path = RunFolder(run).record(key(RunFolder(run), "nod", 0))
    record = decode(path.read_bytes(), Record, RECORD_SCHEMA)
    path.write_text(encode(replace(record, sent=None), RECORD_SCHEMA))
    assert refusal("report", run, "--import-tasks", "--videos", "all") == "1"
    out = capsys.readouterr().out
    assert "No video of nod, episode 0: It has no joint targets." in out
    assert "1 video made" in out
    video = 'src="videos/wave/random.sim.none.default/00000.webm"'
    assert video in (run / "index.html").read_text()


@pytest.mark.slow
def test_command_of_the_report_makes_the_same_report(tmp_path: Path, evaluate: Told) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    evaluate(one, "--look", "dark")
    (command,) = RunFolder(one).commands()
    assert html.escape(command) in (one / "index.html").read_text()
    program, *words = shlex.split(command)
    assert program == "duobench"
    main([str(two) if word == "DIR" else word for word in words])
    for name in ("summary.json", "run.json"):
        assert (one / name).read_bytes() == (two / name).read_bytes()
    pages = [(folder / "index.html").read_text() for folder in (one, two)]
    assert without_times(pages[0]) == without_times(pages[1])


def test_command_has_every_option_that_a_result_may_depend_on() -> None:
    options = list(options_of(EVAL))
    given: dict[str, object] = {}
    for option in options:
        value = f"my {option.name}"
        if option.is_nested:
            setattr(given.setdefault(option.argument, SimpleNamespace()), option.name, value)
        else:
            given[option.name] = value
    command = command_line("eval", EVAL, given)
    for option in options:
        elsewhere = {"out": "DIR", "server": "URL", "key_file": "FILE"}
        value = elsewhere.get(option.name, f"'my {option.name}'")
        no_matter = {"workers", "wait", "retry_broken"}
        no_matter |= {"executor", "address", "policy_gpus", "shard", "observer"}
        assert (f"{option.flag} {value}" in command) == (option.name not in no_matter), option.name


def test_each_command_has_a_file_of_its_name() -> None:
    folder = Path(program.__file__).parent
    inside = [path.relative_to(folder).with_suffix("") for path in folder.rglob("*.py")]
    names = {" ".join(path.parts) for path in inside if path.stem != "__init__"}
    assert {name for name in names if not name.startswith("shared ")} == {"program", *COMMANDS}
    assert all(inspect.isfunction(function_of(name)) for name in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_no_group_of_options_is_longer_than_ten(command: str) -> None:
    groups: dict[str, list[str]] = {}
    for option in options_of(function_of(command)):
        if "Positional" not in str(option.kind):
            groups.setdefault(option.argument if option.is_nested else "", []).append(option.flag)
    assert {name: flags for name, flags in groups.items() if len(flags) > 10} == {}


def test_command_of_a_served_policy_says_how_it_is_asked(tmp_path: Path, evaluate: Told) -> None:
    serve = Serve()
    url = f"ws://127.0.0.1:{serve(toy_batches.Wanders())}"
    evaluate(tmp_path / "run", "--policy", "openpi", "--server", url, "--execute", "7")
    serve.close()
    (command,) = RunFolder(tmp_path / "run").commands()
    assert "--policy openpi --server URL " in command
    assert "--execute 7" in command
    assert url not in (tmp_path / "run" / "run.json").read_text()


def test_comparison_has_a_row_a_pair_and_says_where_the_page_is(tmp_path: Path, told: Told) -> None:
    new, old = (
        play(tmp_path / name, {"sort": [stage] * 12}, name)
        for name, stage in (("new", 3), ("old", 1))
    )
    out = told("compare", new, old, "paper:ACT", "--out", tmp_path / "both")
    assert "1 / 0 of 1" in out
    assert "+100.0" in out
    assert f"Comparison: {tmp_path / 'both' / 'index.html'}" in out
    assert (tmp_path / "both" / "index.html").is_file()


def test_nothing_to_recover_is_said(tmp_path: Path, told: Told) -> None:
    DataSet.open(tmp_path)
    assert told("data", "recover", tmp_path) == "There is nothing to recover.\n"


def test_list_tells_every_task(told: Told) -> None:
    words = " ".join(told("list", "--stages").split())
    assert "{" not in words
    for name in catalog.names():
        task = catalog.get(name)
        assert f"{name} {task.category} {task.max_stage} {task.horizon} " in words
        for number, stage in enumerate(task.stages, 1):
            assert f"{number} {stage.name}"[:60] in words


def test_list_tells_every_look(told: Told) -> None:
    rows = [line.split() for line in told("list", "--looks").splitlines()]
    found = [row[0] for row in rows if row and row[0][0].islower()]
    assert found == [*looks.names(), "random:SEED"]
    assert ["noisy", "exposure,", "blur,", "noise"] in rows


def test_render_draws_every_camera(tmp_path: Path, told: Told) -> None:
    words = ["--seed", "5", "--size", "48", "64", "--out", tmp_path]
    paths = [Path(path) for path in told("render", toy_tasks.WAVE_NAME, *words).split()]
    cameras = ("head", "left_wrist", "right_wrist", "overview")
    assert [path.name for path in paths] == [f"wave-5-{camera}.png" for camera in cameras]
    for path in paths:
        with Image.open(path) as image:
            assert image.size == (64, 48)
            low, high = image.convert("L").getextrema()
            assert high - low > 50


def test_render_shows_the_gripper_that_is_asked_for(tmp_path: Path, told: Told) -> None:
    words = (toy_tasks.WAVE_NAME, "--cameras", "left_wrist", "--size", "90", "160", "--out")
    told("render", *words, tmp_path / "usual")
    told("render", *words, tmp_path / "hand", "--gripper", "franka_hand")
    usual, hand = (
        np.array(Image.open(tmp_path / name / "wave-0-left_wrist.png")).astype(int)
        for name in ("usual", "hand")
    )
    assert (np.abs(usual - hand).max(axis=-1) > 30).mean() > 0.1


def test_render_shows_depth_and_parts_of_a_camera_of_ones_own(tmp_path: Path, told: Told) -> None:
    side = '{"name": "side", "position": [0.5, 1.2, 0.5], "look_at": [0.5, 0, 0]}'
    words = ["--cameras", "head", side, "--depth", "--segmentation", "--size", "48", "400"]
    found = told("render", toy_tasks.WAVE_NAME, *words, "--out", tmp_path).split()
    names = [
        f"{camera}{end}" for end in ("", "-depth", "-segmentation") for camera in ("head", "side")
    ]
    assert [Path(path).name for path in found] == [f"wave-0-{name}.png" for name in names]
    for path in found[2:]:
        with Image.open(path) as image:
            assert image.width == 400
            assert image.height > 48, "a legend"
            assert len(np.unique(np.array(image).reshape(-1, 3), axis=0)) > 3


def test_two_cameras_of_one_name_are_not_rendered_into_one_file(tmp_path: Path) -> None:
    side = '{"name": "side", "position": [0.5, 1.2, 0.5], "look_at": [0.5, 0, 0]}'
    words = ["--cameras", side, side.replace("1.2", "1.3"), "--out", str(tmp_path / "renders")]
    assert "Two cameras are called 'side'" in refusal("render", toy_tasks.WAVE_NAME, *words)


def test_doctor_tells_versions_and_graphics(told: Told) -> None:
    out = told("doctor")
    assert {line.split()[0] for line in out.splitlines()[:-1]} <= {"ok", "note"}
    for word in ("mujoco", "suite version", "backend", "renderer", "three cameras"):
        assert word in out
    assert " ms at 224x224" in out
    said = out.splitlines()[-1].removeprefix("All is well. Next: duobench ")
    assert parsed(said.split())


def found_by_doctor(done: subprocess.CompletedProcess[str]) -> dict[str, str]:
    """What its checks say, from how they ended on, by their names."""
    assert "Traceback" not in done.stdout + done.stderr
    rows = [re.split(r"  +", line, maxsplit=2) for line in done.stdout.splitlines()]
    return {name: f"{outcome} {words}" for outcome, name, words in (row for row in rows if row[2:])}


@pytest.mark.slow
def test_doctor_looks_at_what_is_left_to_it_by_others(tmp_path: Path) -> None:
    """What a kernel, a shell or a script of a job hands over; all of it is no reason to stop."""
    backend = "module://matplotlib_inline.backend_inline"
    done = duobench(
        "doctor",
        "--out",
        "new/run",
        folder=tmp_path,
        MPLBACKEND=backend,
        OMP_NUM_THREADS="many",
        PYTHONIOENCODING="ascii",
        TMPDIR=str(tmp_path / "absent"),
        https_proxy="secret",
        HOME="/proc/absent",
        XDG_CACHE_HOME="",
        XDG_CONFIG_HOME="",
    )
    assert done.returncode == 0
    found = found_by_doctor(done)
    assert found["output"].startswith(f"ok {tmp_path} can be written")
    assert found["figures"].startswith("note drawn by Matplotlib")
    assert found["locale"].startswith("note names of files in utf-8, output in ascii")
    assert found["variables"].startswith("note ")
    assert "https_proxy" in found["variables"]
    assert found["variables"].endswith("OMP_NUM_THREADS is a whole number from 1 on.")
    assert found["videos"].startswith("ok encoded by libvpx-vp9")
    assert "secret" not in done.stdout
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_doctor_fails_where_a_run_would(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    done = duobench("doctor", "--out", "file/run", folder=tmp_path, MUJOCO_GL="off")
    assert done.returncode == 1
    found = found_by_doctor(done)
    assert found["output"].startswith("failed Cannot write file/run: there is no folder ")
    assert found["images"].startswith("failed Rendering is switched off by MUJOCO_GL=off")
    assert found["figures"].startswith("ok")


READ_ONLY = """
mount --make-rprivate /
mount --bind "$1" "$1"
mount --bind /dev/shm /dev/shm
mount --options remount,bind,ro /dev/shm  # bind: the machine's own stays as it is
mount --options remount,bind,ro /
mount --options remount,bind,rw "$1"
cd /
shift
for words; do "$PYTHON" -P -m duobench $words || exit; done
"""


@pytest.mark.long
@pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("unshare") is None, reason="needs root and unshare"
)
def test_only_the_output_must_be_writable(tmp_path: Path) -> None:
    """No home, no folder for temporary files, and the output itself is what was mounted."""
    lines = [
        "eval --policy hold --tasks bin_sort --episodes 1 --videos 0 --out {}",
        "eval --policy hold --tasks bin_sort --episodes 2 --videos 0 --out {}",
        "verify {}",
        "report {}",
        "doctor --out {}",
    ]
    environment = {"PYTHON": sys.executable, "PYTHONPATH": PATH, "PATH": os.environ["PATH"]}
    done = subprocess.run(
        ["unshare", "--mount", "sh", "-c", READ_ONLY, "sh", tmp_path]
        + [line.format(tmp_path) for line in lines],
        env={**environment, "HOME": "/absent", "TMPDIR": "/absent"},
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Verified." in done.stdout
    assert "No usual folder for them can be written" in done.stdout
    assert not list(tmp_path.glob(".*"))


@pytest.mark.long
def test_what_renders_is_told_where_it_is_asked(tmp_path: Path) -> None:
    words = ["render", "bin_sort", "--size", "48", "64", "--out", str(tmp_path)]
    quiet, told = (
        duobench(*words, *more, folder=tmp_path, DUOBENCH_GL="") for more in ([], ["--verbose"])
    )
    assert (quiet.returncode, quiet.stderr, quiet.stdout) == (0, "", told.stdout)
    is_software = "the processor" in duobench("doctor", DUOBENCH_GL="").stdout
    assert ("No graphics card renders here" in told.stderr) == is_software


@pytest.mark.parametrize(
    ("words", "backend", "reason"),
    quick_first(
        [
            ("doctor", "off", "Rendering is switched off by MUJOCO_GL=off"),
            ("render bin_sort --out run", "bogus", "or unset it"),
            ("doctor", "bogus", "or unset it"),
            ("eval --policy hold --out run", "bogus", "or unset it"),
        ],
        quick=2,
    ),
)
def test_graphics_that_are_not_there_are_told_in_words(
    tmp_path: Path, words: str, backend: str, reason: str
) -> None:
    done = duobench(*words.split(), folder=tmp_path, MUJOCO_GL=backend)
    assert done.returncode == 1
    assert f"MUJOCO_GL={backend}" in done.stdout + done.stderr
    assert reason in done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert ("suite version" in done.stdout) == (words == "doctor")
    assert backend != "off" or "mujoco" in done.stdout


def test_wrong_arguments_are_refused_with_the_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert refusal("eval", "--policy", "hold", "--out", "run", "--executor", "slurm") == "2"
    assert "processes" in capsys.readouterr().err


def test_policy_of_a_wrong_name_can_be_corrected(tmp_path: Path, evaluate: Told) -> None:
    with pytest.raises(SystemExit, match="no module named"):
        evaluate(tmp_path / "run", "--policy", "nomod:Foo")
    evaluate(tmp_path / "run", "--policy", "hold")
    assert (tmp_path / "run" / "index.html").exists()


@pytest.mark.long
def test_broken_episodes_are_told_and_played_again(tmp_path: Path) -> None:
    """Beside the policy lie files that are named as modules of the standard library are."""
    for name in ("signal", "random", "queue", "tempfile", "socket"):
        (tmp_path / f"{name}.py").write_text("raise ImportError('not the real one')\n")
    (tmp_path / "mine.py").write_text(BREAKS_ONCE)
    words = ["eval", "--policy", "mine:Mine", "--tasks", toy_tasks.WAVE_NAME, "--episodes", "1"]
    words += ["--videos", "0", "--out", "run"]
    done = duobench(*words, folder=tmp_path)
    assert done.returncode == 1
    for said in (
        "wave, episode 0 failed with an error: SystemExit: 3",
        "1 episode failed with an error",
        "--retry-broken",
        "Report: run/index.html",
    ):
        assert said in done.stdout
    assert duobench(*words, folder=tmp_path).returncode == 1
    done = duobench(*words, "--retry-broken", folder=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "failed" not in done.stdout


def test_other_run_is_refused_with_its_command(tmp_path: Path, evaluate: Told) -> None:
    evaluate(tmp_path / "run")
    told = r"policy hold instead.*--out another folder, such as .*hold,.*--policy random"
    with pytest.raises(SystemExit, match=told):
        evaluate(tmp_path / "run", "--policy", "hold")


@pytest.mark.parametrize("verb", ["eval", "record"])
def test_folder_in_use_is_refused_with_who_uses_it(tmp_path: Path, verb: str) -> None:
    if verb == "record":
        DataSet.open(tmp_path)
    words = [verb, "--policy", "hold", "--tasks", toy_tasks.WAVE_NAME, "--workers", "0"]
    with locked(tmp_path) if verb == "record" else RunFolder(tmp_path).writer():
        refused = refusal(*words, "--out", tmp_path)
    assert "Another process " in refused
    assert refused.endswith(f"wait until process {os.getpid()} is done. Give --out another folder.")


@pytest.mark.slow
def test_full_disk_is_told_in_a_sentence_and_the_same_command_goes_on(tmp_path: Path) -> None:
    """A limit on the size of files stands for a full disk: the system refuses in the same way.

    4000 bytes hold the description of the run (about 3000) and a record, and no
    figure (about 5000).
    """
    script = (
        "import resource, sys; from duobench.cli import main\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000))\n"
        "main(sys.argv[1:])\n"
    )
    words = ["eval", "--policy", "hold", "--tasks", toy_tasks.WAVE_NAME, "--episodes", "1"]
    words += ["--videos", "0", "--workers", "0", "--out", str(tmp_path / "run")]
    done = python("-c", script, *words)
    assert done.returncode == 1
    assert done.stderr.startswith("error: Cannot write ")
    assert "File too large. Nothing finished is lost. Make room" in done.stderr
    assert len(list(tmp_path.glob("run/records/*/*/*.json"))) == 1
    main(words)


def test_output_that_is_full_is_told_in_a_sentence() -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "duobench", "list"]
        told = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert told.returncode == 1
    assert told.stderr == "error: the output: No space left on device. What is finished is kept.\n"


@pytest.mark.slow
@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-", ">&- 2>&- <&-"])
def test_output_may_be_closed(closed: str) -> None:
    command = f"{shlex.quote(sys.executable)} -m duobench list {closed}"
    told = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert (told.returncode, told.stderr) == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize("closed", [">&-", ">&- <&-"])
def test_processes_of_a_run_are_silent_where_outputs_are_closed(
    tmp_path: Path, closed: str
) -> None:
    words = ["eval", "--policy", "hold", "--tasks", toy_tasks.WAVE_NAME, "--episodes", "1"]
    words += ["--videos", "0", "--out", str(tmp_path / "run")]
    command = f"{shlex.join([sys.executable, '-m', 'duobench', *words])} {closed}"
    told = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert (told.returncode, told.stdout, told.stderr) == (0, "", "")
    assert len(list(tmp_path.glob("run/records/*/*/*.json"))) == 1


@pytest.mark.slow
def test_figures_are_silent_about_a_home_that_cannot_be_written() -> None:
    code = "from duobench.cli import main\nmain(['--version'])\nimport duobench.results.figures"
    homes = {"HOME": "/proc/none", "XDG_CONFIG_HOME": "", "XDG_CACHE_HOME": "", "MPLCONFIGDIR": ""}
    assert python("-P", "-c", code, **homes).stderr == ""


@pytest.mark.slow
def test_output_may_have_any_encoding(tmp_path: Path, evaluate: Told) -> None:
    evaluate(tmp_path / "run")
    done = duobench("report", str(tmp_path / "run"), PYTHONIOENCODING="ascii")
    assert done.returncode == 0, done.stderr
    assert "All tasks" in done.stdout


def test_table_of_a_folder_that_cannot_be_written_is_shown(
    tmp_path: Path, evaluate: Told, capsys: pytest.CaptureFixture[str]
) -> None:
    table = evaluate(tmp_path / "run").partition("Task")[2].partition("Report")[0]
    (tmp_path / "run" / "summary.json").unlink()
    (tmp_path / "run" / "summary.json").mkdir()
    assert refusal("report", tmp_path / "run").startswith("error: Cannot write")
    assert capsys.readouterr().out.partition("Task")[2].partition("Report")[0] == table


def test_narrow_list_still_shows_every_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    out = io.StringIO()
    monkeypatch.setattr("duobench.cli.list.console", lambda: Console(file=out, width=60))
    main(["list"])
    words = set(out.getvalue().split())
    for name in catalog.names():
        task = catalog.get(name)
        instruction = re.sub(r"{(\w+)}", r"<\1>", task.instruction).split()
        assert {name, str(task.horizon), *f"({task.category})".split(), *instruction} <= words


def test_text_of_people_is_printed_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    console().print("policy [bold]x[/] :smile: [/nothing]")
    assert capsys.readouterr().out == "policy [bold]x[/] :smile: [/nothing]\n"


def test_version_is_told(told: Told) -> None:
    assert told("--version") == f"duobench {__version__}\n"


@pytest.mark.slow
def test_interrupt_that_an_import_would_swallow_ends_the_run(tmp_path: Path) -> None:
    (tmp_path / "swallows.py").write_text(
        "import os, signal\n"
        "try:\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "except BaseException:\n"
        "    pass\n"
        "from tests.evaluation.toy_tasks import WAVE\n"
    )
    words = ["eval", "--policy", "hold", "--tasks", "swallows:WAVE", "--out", "run"]
    done = duobench(*words, folder=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "\nStopped.\n")
    assert not (tmp_path / "run").exists()


def test_interrupt_while_the_package_is_imported_is_answered_in_words(tmp_path: Path) -> None:
    (tmp_path / "gymnasium.py").write_text(
        "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n"
    )
    path = os.pathsep.join([str(tmp_path), str(ROOT / "src")])
    script = "from duobench_command import main; main()"
    done = python("-c", script, "list", PYTHONPATH=path)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "\nStopped.\n")


@contextmanager
def started(*words: str) -> Iterator[subprocess.Popen[str]]:
    """A command of its own in a group of processes of its own."""
    command, pipe = [sys.executable, "-m", "duobench", *words], subprocess.PIPE
    with subprocess.Popen(
        command, stdout=pipe, stderr=pipe, text=True, start_new_session=True
    ) as process:
        yield process


@pytest.mark.long
@pytest.mark.parametrize("moment", ["starting", "playing", "pressed twice", "terminated"])
def test_interrupt_is_answered_in_words(tmp_path: Path, moment: str) -> None:
    words = ["eval", "--policy", "hold", "--episodes", "500", "--tasks", toy_tasks.WAVE_NAME]
    words += ["--videos", "0", "--workers", "2", "--out", str(tmp_path / "run")]
    with started(*words) as process:
        if moment == "starting":
            wait_until(lambda: workers(process.pid), "a worker")
        else:
            wait_until(lambda: list(tmp_path.glob("run/records/*/*/*.json")), "a record")
        number = signal.SIGTERM if moment == "terminated" else signal.SIGINT
        os.killpg(process.pid, number)  # as a terminal does: every process of the group gets it
        if moment == "pressed twice":
            time.sleep(0.02)
            os.killpg(process.pid, signal.SIGINT)
        said, complaint = process.communicate()
    assert process.returncode == 128 + number
    # Who presses twice may cut off this line, and nothing else; before an attempt nothing is kept.
    is_told = "the same command goes on" in said
    assert moment in {"pressed twice", "terminated"} or is_told == (tmp_path / "run").exists()
    assert is_told or moment != "playing"
    assert complaint.strip() == "Stopped."


@pytest.mark.slow
def test_failures_that_are_kept_and_layouts_of_the_evaluation_are_told(
    told: Told, tmp_path: Path
) -> None:
    where = ["--policy", "hold", "--tasks", "bin_sort", "--split", "eval", "--out", tmp_path / "d"]
    said = told("record", *where, "--keep-failures", "--episodes", 2, "--workers", 0)
    assert "2 episodes, 0 steps until success" in said
    assert "; 0 more did not succeed.\n2 of the episodes did not succeed.\n" in said
    exported = told(
        "export", "lerobot", tmp_path / "d", "--out", tmp_path / "e", "--cameras", "none"
    )
    assert "2 episodes with layouts that policies are evaluated on: train on others." in exported


@pytest.mark.slow
def test_interrupted_recording_says_that_it_goes_on(tmp_path: Path) -> None:
    words = ["record", "--policy", "hold", "--keep-failures", "--tasks", "bin_sort"]
    with started(*words, "--workers", "0", "--out", str(tmp_path / "demos")) as process:
        wait_until(lambda: list(tmp_path.glob("demos/episodes/*/*.parquet")), "an episode")
        process.send_signal(signal.SIGINT)
        said, complaint = process.communicate()
    assert (process.returncode, complaint.strip()) == (130, "Stopped.")
    assert "What is finished is kept; the same command goes on from there." in said


@pytest.mark.parametrize(
    ("verb", "words"),
    quick_first(
        [
            ("eval", ["--policy", f"{toy_tasks.__name__}:NeverReady", "--tasks", "bin_sort"]),
            ("record", ["--policy", f"{toy_tasks.__name__}:NeverReady", "--tasks", "bin_sort"]),
        ]
    ),
)
def test_nothing_is_said_to_be_kept_where_nothing_is(
    tmp_path: Path, verb: str, words: list[str]
) -> None:
    with started(verb, *words, "--workers", "0", "--out", str(tmp_path / "new")) as process:
        assert process.stderr is not None
        while process.stderr.readline().strip() != "not ready":
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        said, complaint = process.communicate()
    assert (process.returncode, complaint.strip()) == (130, "Stopped.")
    assert "kept" not in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("duobench.cli", "tyro rich matplotlib jinja2 av PIL duobench.evaluation"),
        ("duobench.results.report", "scipy"),
    ],
)
def test_importing_a_module_loads_nothing_heavy(module: str, heavy: str) -> None:
    loaded = set(printed(f"import sys, {module}; print(*sorted(sys.modules))").split())
    assert module in loaded
    assert loaded & set(heavy.split()) == set()


def test_help_loads_nothing_heavy() -> None:
    code = "import sys; from duobench.cli.program import *; [function_of(one) for one in COMMANDS]"
    loaded = {*printed(f"{code}; print(*sys.modules)").split()}
    assert "duobench.cli.real.eval" in loaded
    assert not loaded & {"mujoco", "scipy", "matplotlib", "jinja2", "av", "pyarrow"}


def test_only_the_command_line_names_its_flags() -> None:
    """Neither errors nor pages of the library do; cards may, whose readers have nothing else."""
    flags = []
    for path in (ROOT / "src" / "duobench").rglob("*.j2"):
        if path.name == "card.md.j2":
            continue
        flags += re.findall(r"(?<![\w-])--[a-z][a-z-]+[ <]|duobench [a-z]+ [A-Z]", path.read_text())
    for path in (ROOT / "src" / "duobench").rglob("*.py"):
        if ROOT / "src" / "duobench" / "cli" in path.parents or path.name == "__main__.py":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Raise):
                flags += re.findall(r"--[a-z]+|duobench [a-z]+ ", ast.unparse(node))
    assert flags == []
