"""What a command says where something is misspelt, missing, or does not fit: one line in words."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import pytest

from duobench.data import DataSet
from duobench.policy.serving.access import KEY_VARIABLE
from duobench.policy.serving.address import SERVED
from tests.cli.conftest import refusal
from tests.cli.real.test_doctor import lab
from tests.results.outcomes import play

ONE = "--tasks bin_sort --episodes 1"
"""What is played soon, should a mistake not be told."""
MISTAKEN = """
def answer(observation): ...
class Loads:
    def __init__(self, path): ...
made = Loads("weights")
"""
MISSPELT = """
from dataclasses import replace
from duobench.tasks import Stage, get, rests_on
FIRST = Stage(name="first", instruction="Rest.", holds=rests_on("white_cube", "white_bwol"))
TASK = replace(get("bin_sort"), id="misspelt", stages=(FIRST, *get("bin_sort").stages))
"""


def slow(words: str, message: str) -> Any:
    """A mistake that a new process finds, as others here do."""
    return pytest.param(words, message, marks=pytest.mark.slow)


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with an empty data set, what looks like an evaluation, and neither."""
    monkeypatch.delenv(KEY_VARIABLE, raising=False)
    monkeypatch.setitem(sys.modules, "trustme", None)
    monkeypatch.chdir(tmp_path)
    DataSet.open("demos")
    for name in ("runs/x", "folder"):
        Path(name).mkdir(parents=True)
    Path("runs/x/run.json").write_text("{}")
    Path("link").symlink_to("demos")
    Path("file.zip").write_bytes(b"none")
    Path("mistaken.py").write_text(MISTAKEN)
    Path("misspelt.py").write_text(MISSPELT)
    monkeypatch.syspath_prepend(tmp_path)
    lab(tmp_path, "lavfi:testsrc2=size=1280x720")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("eval --policy exprt --out OUT", "Did you mean 'expert'"),
        ("eval --policy hold --out OUT --tasks bin_sorts", "Did you mean 'bin_sort'"),
        ("eval --policy hold --out OUT --tasks bin_sort bin_sort", "more than once: bin_sort"),
        ("eval --policy hold --out OUT --episodes 0", "at least one episode"),
        ("eval --policy no.such.module:make --out OUT", "no module named"),
        ("eval --policy hold --out OUT ONE --workers -3", "got -3"),
        ("eval --policy hold --out OUT ONE --videos -1", "got -1"),
        ("eval --policy hold --out /proc/run", "/proc/run cannot be the folder"),
        ("eval --policy hold --out /proc/run", "give --out another folder; the same"),
        ("eval --policy hold --out OUT ONE --act-timeout 0", "limits are positive"),
        ("eval --policy x\udcff:X --out OUT", r"'x\udcff:X'"),
        slow("eval --policy :x --out OUT", "is no `module:attribute`"),
        ("eval --policy mine.py --out OUT", "mine:MyPolicy for MyPolicy in mine.py"),
        ("eval --policy mine.Mine --out OUT", "mine:Mine for Mine in mine.py"),
        (
            "eval --policy openpi --out OUT",
            "openpi or vla-eval and --server URL go together",
        ),
        ("eval --policy hold --out OUT --server ws://x:1", "openpi or vla-eval and --server"),
        (
            "eval --policy vla-eval --out OUT",
            "openpi or vla-eval and --server URL go together",
        ),
        ("eval --policy vla-eval --out OUT --server http://x:1", "ws://HOST:PORT"),
        ("eval --policy vla-eval --out OUT --server ws://x:1 --batch fixed", "up to the server"),
        ("eval --policy vla_eval --out OUT", "Did you mean 'vla-eval'"),
        ("eval --policy openpi --out OUT --server x:1", "ws://HOST:PORT"),
        ("eval --policy hold --out OUT --format aloha", "--format is for"),
        (
            "eval --policy openpi --out OUT --server ws://x:1 --format alhoa",
            "Did you mean 'aloha'",
        ),
        ("evaluate", "no command 'evaluate'. Did you mean `duobench eval`?"),
        ("walk", "There are: eval, report, "),
        # Names that stand for something else.
        (
            "eval --policy act --out OUT",
            "Unknown policy 'act'. Known: blind, expert, hold, lerobot:",
        ),
        ("eval --policy hold --tasks --out OUT", "--tasks needs a task"),
        ("eval --policy trained/last --out OUT", "is lerobot:trained/last, not 'trained/last'"),
        slow(
            "eval --policy mistaken --out OUT", "is a module; name a class in it, such as mistaken:"
        ),
        slow("eval --policy ./mistaken:X --out OUT", "found by its name: mistaken:X"),
        slow("eval --policy mistaken.py:X --out OUT", "found by its name: mistaken:X"),
        (
            "eval --policy mistaken:Load --out OUT",
            "mistaken has no class or function 'Load'",
        ),
        slow(
            "eval --policy mistaken:made --out OUT", "mistaken, whose made is of type Loads, has no"
        ),
        slow(
            "eval --policy mistaken:answer --out OUT", "A policy is made without arguments, and has"
        ),
        ("eval --policy mistaken:Loads --out OUT", "A policy is made without arguments, and has"),
        ("eval --policy hold --out OUT --tasks bin_sort,carry_pot", "spaces: bin_sort carry_pot"),
        ("eval --policy hold --out OUT --tasks all", "none means all"),
        ("eval --policy hold --out OUT --tasks Bin-Sort", "Did you mean 'bin_sort'"),
        ("eval --policy hold --out OUT --tasks duobench/bin_sort", "Did you mean 'bin_sort'"),
        ("eval --policy hold --out OUT ONE --look random", "Did you mean 'random:SEED'"),
        ("eval --policy hold --out OUT ONE --shift look", "AXIS-LEVEL, such as look-3; got 'look'"),
        (
            "eval --policy hold --out OUT ONE --shard 0/4",
            "Shards count from 1: of 4 there are 1 to 4",
        ),
        ("help", "Did you mean `duobench --help`?"),
        ("run", "Did you mean `duobench eval`?"),
        ("train diffusion --data demos --out OUT", "--per-task --cameras none --object-state"),
        ("train act --data demos --out OUT", "duobench export lerobot demos --out demos-lerobot"),
        ("export lerobot demos --out demos", "demos is in "),
        ("export lerobot demos --out link/sub", "link/sub is in "),
        ("data merge demos --out demos/sub", "demos/sub is in "),
        ("data merge demos --out link/sub", "link/sub is in "),
        ("data split demos --out a demos/b --fraction 0.5", "demos/b is in "),
        ("compare runs/x runs/x --out runs/x/compared", "runs/x/compared is in runs/x"),
        ("bundle runs/x --out runs/x/x.zip", "runs/x/x.zip is in "),
        ("render nothing", "Unknown task 'nothing'"),
        ("render misspelt:TASK", "'white_bwol'. Did you mean 'white_bowl'"),
        ("render bin_sort --seed -1", "from 0 on, got -1"),
        ("render bin_sort --cameras haed", "Did you mean 'head'"),
        ("render bin_sort --cameras {bad", "{bad is no camera: Expecting property name"),
        (
            'render bin_sort --cameras {"nam":"side"}',
            "field of a camera 'nam'. Did you mean 'name'",
        ),
        ('render bin_sort --cameras {"name":"side"}', "position, look_at is missing"),
        ("render bin_sort --cameras mistaken:side", "mistaken has no camera 'side'"),
        ("export lerobot demos --out OUT --depth haed", "Did you mean 'head'"),
        ("render bin_sort --out /proc/run", "/proc/run cannot be the folder"),
        ("report runs/y", "There is no folder runs/y. Beside it there are: runs/x."),
        ("report demos", "demos is a data set, not an evaluation. Try: duobench data info demos"),
        ("replay demoz", "There is no folder demoz. Beside it there are: demos"),
        (
            "data info runs/x",
            "runs/x is an evaluation, not a data set. Try: duobench report runs/x",
        ),
        ("data split demos --out a b", "--fraction 0.8, or all of some tasks, such as --tasks"),
        ("data chek demos", "Did you mean `duobench data check`?"),
        ("export demos", "Did you mean `duobench export lerobot demos`?"),
        ("serve --policy hold --host 0.0.0.0", "could be used by everyone"),
        ("serve --policy hodl --port 0", "Did you mean 'hold'"),
        ("serve --policy hold --max-batch 0", "at least one observation"),
        ("serve --policy hold --key-file absent", "Cannot read the key in absent"),
        ("serve --policy expert:human", "expert:human reads the state of the simulator"),
        ("teleop carry_pto --out OUT", "Did you mean 'carry_pot'"),
        ("teleop carry_pot --out OUT --leader gelo:x", "--leader is gello:FILE or lerobot:KIND"),
        ("teleop carry_pot --out OUT --leader gello:x --lockstep", "leave out --lockstep"),
        ("teleop carry_pot --out OUT --leader gello:nowhere.toml", "nowhere.toml"),
        ("teleop carry_pot --out OUT --episodes 0", "at least one episode"),
        (f"teleop carry_pot --out OUT --episodes {10**12}", "at most 10,000 layouts"),
        (f"teleop carry_pot --out OUT --operator {'x' * 61}", "--operator cannot be recorded"),
        ("teleop carry_pot --out OUT --operator a\x1b[1m", "line that can be printed"),
        (f"real teleop carry_pot --out OUT --rig rehearsal --instruction {'x' * 301}", "<= 300"),
        ("teleop carry_pot --out OUT --port 70000", "Cannot listen at 127.0.0.1:70000"),
        ("view carry_pto", "Did you mean 'carry_pot'"),
        ("view somewhere/else", "Unknown task 'somewhere/else'"),
        ("view folder", "holds neither a data set (dataset.json) nor an evaluation (run.json)"),
        ("view file.zip", "file.zip"),
        ("view carry_pot --look drak", "Did you mean 'dark'"),
        ("view carry_pot --port 70000", "Cannot listen at 127.0.0.1:70000"),
        ("view carry_pot --lan", "pip install '.[teleop]'"),
        ("verify nowhere", "There is no folder"),
        ("bundle nowhere", "There is no folder"),
        ("report nowhere --out out", "There is no folder"),
        ("verify file.zip", "is no whole bundle"),
        ("bundle file.zip", "holds no evaluation"),
        ("report file.zip --out out", "is no whole bundle"),
        ("real doctor --rig none.json --out x", "There is no file none.json"),
        ("real doctor --rig rehearsal --out x --seconds 0", "more than 0"),
        ("real doctor --rig rehearsal --out x --store-reference", "no file beside which"),
        ("real doctr", "Did you mean `duobench real doctor`"),
        ("real calibrate gripper left --rig rig.json", "has no positions to measure"),
        ("real calibrate bord", "Did you mean `duobench real calibrate board`"),
        ("real calibrate head --rig none.json --views v", "There is no file none.json"),
        ("real calibrate head --rig rig.json --views v", "say --ruler MM"),
        (
            "real calibrate wrist left --rig rig.json --views v --ruler 20",
            "is 200 mm long if it was printed to scale",
        ),
        (
            "real calibrate wrist left --rig rig.json --views v --ruler 200",
            "OpenCV|The rig has no camera left_wrist",
        ),
    ],
)
def test_mistake_is_told_in_a_line_without_traceback(words: str, message: str) -> None:
    before = sorted(Path().rglob("*"))
    refused = refusal(*words.replace("OUT", "out").replace("ONE", ONE).split())
    assert refused.startswith("error: ")
    assert any(part in refused for part in message.split("|"))
    assert "\n" not in refused
    # Before anything begins; to import a module leaves its cache.
    assert [path for path in sorted(Path().rglob("*")) if "__pycache__" not in str(path)] == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("eval --policy hold --task bin_sort --out OUT", "Perhaps you meant: --tasks"),
        ("eval --policy hold --retry_brocken --out OUT", "Perhaps you meant: --retry-broken"),
        ("record --epsiodes=3 --out OUT", "Perhaps you meant: --episodes"),
        ("view carry_pot --prot 3", "Perhaps you meant: --port"),
        ("eval --policy hold --episodes ten --out OUT", "Error parsing --episodes:"),
        ("eval --policy hold --wait=long --out OUT", "could not convert string to float: 'long'"),
        ("eval --policy hold --out", "Missing value for argument '--out'"),
        ("eval --policy hold", "Missing from duobench eval: --out PATH Folder of the run."),
        ("eval --policy hold bin_sort --out OUT", "Unrecognized options: bin_sort"),
        ("train pi0", "invalid choice 'pi0' for argument 'policy'. Expected one of ('act',"),
        ("data", "Expected one of {info, check,"),
        # Options that other programs have.
        ("eval --policy hold --camera head --out OUT", "PolicyMetadata(cameras="),
        ("eval --policy hold --gpu 0 --out OUT", "A policy chooses its device itself"),
        ("eval --policy hold --seed 3 --out OUT", "Seeds follow from task and episode"),
        ("eval --policy hold --max_steps=9 --out OUT", "The task fixes its horizon"),
        ("train act --data demos --out OUT --batch_size 8", "-- --batch_size=8"),
    ],
)
def test_mistake_in_options_is_told_by_tyro(
    words: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refusal(*words.replace("OUT", "out").split()) == "2"
    told = " ".join(re.sub("[│╭╮╰╯─]", " ", capsys.readouterr().err).split())
    assert message in told
    assert "Traceback" not in told
    assert not Path("out").exists()


def test_no_advice_about_an_option_that_a_command_has(capsys: pytest.CaptureFixture[str]) -> None:
    refusal("render", "bin_sort", "--seed", "one", "--", "--resume")
    assert "Seeds follow" not in capsys.readouterr().err


@pytest.mark.parametrize("policy", SERVED)
def test_server_that_is_not_there_is_told_without_its_address(policy: str) -> None:
    words = ["eval", "--policy", policy, "--server", "ws://127.0.0.1:1", "--wait", "0"]
    refused = refusal(*words, "--workers", "0", "--out", "run")
    assert "The policy's server cannot be reached" in refused
    assert "127.0.0.1" not in refused


def test_wait_for_a_server_is_told_before_it_begins(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["eval", "--policy", "openpi", "--server", "ws://127.0.0.1:1", "--wait", "0.25"]
    refusal(*words, "--workers", "0", "--out", "run")
    said = "Connecting to the policy's server; waiting up to 0.25 s for it.\n"
    assert capsys.readouterr().out.endswith(said)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("new old --out new", "new is in new, which is read"),
        ("new newx --out out", "There is no folder newx. Beside it there are:"),
        ("new paper:AKT --out out", "Did you mean 'paper:ACT'"),
        ("new authors:xlva --out out", "Did you mean 'authors:xvla'"),
        ("new --out out", "A comparison takes 2 to 26 runs, got 1."),
    ],
)
def test_what_cannot_be_compared_is_told(words: str, message: str) -> None:
    for name, stage in (("new", 3), ("old", 1)):
        play(Path(name), {"sort": [stage] * 2}, name)
    assert message in refusal("compare", *words.split())
