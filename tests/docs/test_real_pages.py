"""Pages on real arms: what they show works, with rehearsals and scripted operators."""

from __future__ import annotations

import os
import shlex
import subprocess
import threading
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Any

import pytest

from duobench.cli import main
from duobench.cli.shared.rigs import KeyTerminal
from duobench.data import DataSet
from duobench.real.calibration.views import ViewFolder
from duobench.real.rig import Rig
from duobench.real.sessions.operator import QUIT
from duobench.real.sessions.preparing import ACTIVATE_BUTTON, HOME_BUTTON, PLACED_BUTTON
from duobench.real.sessions.rig_teleoperation import ENDS
from tests.docs.markdown import attend, blocks, command, page_of, run, run_python, text_of
from tests.quick_first import quick_first
from tests.real.sessions.operator import Operator
from tests.web.pages import Page

ARMS, CAMERAS, EVALUATION, RECORDING, SAFETY, SETUP = (
    page_of(f"real_{name}")
    for name in ("arms", "cameras", "evaluation", "recording", "safety", "setup")
)


# --- arms ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("page", quick_first([SAFETY, ARMS]), ids=lambda page: page.stem)
def test_programs_run(page: Path, tmp_path: Path) -> None:
    for code in blocks(page, "python"):
        assert run_python(code, tmp_path)


@pytest.mark.slow
def test_the_command_brings_a_rig_home(tmp_path: Path) -> None:
    (line,) = blocks(ARMS, "sh")
    words, _, rest = line.strip().partition(" | ")
    assert words == 'printf "activate\\nhome\\n"'
    assert "Both arms are home." in run(rest, tmp_path, "activate\nhome\n")


@pytest.mark.parametrize(("more", "code"), quick_first([("", 1), (" --check", 0)]))
def test_nothing_moves_without_the_word(more: str, code: int, tmp_path: Path) -> None:
    said = run(f"duobench real home --rig rehearsal --fast{more}", tmp_path, "yes\n", code=code)
    assert "everything answers" in said
    assert "Both arms are home." not in said


def test_the_file_is_a_rig(tmp_path: Path) -> None:
    path = tmp_path / "rig.json"
    path.write_text(*blocks(ARMS, "json"))
    assert len(Rig.read(path).cameras) == 3


# --- a rig and its cameras -----------------------------------------------------------------------


def test_commands_without_hardware_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shown = "\n".join(map(text_of, (SETUP, CAMERAS))).splitlines()
    lines = [line for line in shown if line.startswith("duobench ")]
    runnable = [line for line in lines if "rehearsal" in line or "board" in line]
    assert len(runnable) == 2
    for line in runnable:
        ending = pytest.raises(SystemExit, match="1") if "doctor" in line else nullcontext()
        with ending:  # the grippers of a rehearsal are not active
            main(shlex.split(line)[1:])
    assert (tmp_path / "board.pdf").exists()
    assert (tmp_path / "runs" / "rehearsal" / "doctor.json").exists()


def test_the_rig_and_the_views_of_pages_are_some(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for code in (*blocks(SETUP, "python"), *blocks(CAMERAS, "python")):
        exec(code, {})
    check, _ = blocks(SETUP, "sh")
    main(shlex.split(check)[1:])
    rig = Rig.read(tmp_path / "rig.json")
    assert (rig.cameras["head"].is_side_by_side, rig.is_computed) == (True, False)
    assert len(ViewFolder(tmp_path / "wrist_left", "left_wrist")) == 1


# --- recording -----------------------------------------------------------------------------------

ANSWERS = {
    f"\n{ACTIVATE_BUTTON.key}: {ACTIVATE_BUTTON.words}; q: end.": ACTIVATE_BUTTON.key,
    f"\n{HOME_BUTTON.key}: {HOME_BUTTON.words}; q: end.": HOME_BUTTON.key,
    f"\n{PLACED_BUTTON.key}: {PLACED_BUTTON.words}; q: end.": PLACED_BUTTON.key,
    "k: keep it": "k",
}
"""What the operator answers; another question, as that of teleoperation, ends the session."""
MORE = {"export": " --cameras head --size 32 48", "train": " --print"}
"""What makes commands shorter."""


def answered(line: str, folder: Path) -> str:
    """Run a command, and answer what it asks; what it says."""
    words = command(line + MORE.get(line.split()[1], ""))
    pipe, said = subprocess.PIPE, ""
    with subprocess.Popen(
        words, cwd=folder, stdin=pipe, stdout=pipe, stderr=subprocess.STDOUT, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        for text in process.stdout:
            said += text
            if ENDS in text:
                known = (each for each in ANSWERS if each in f"\n{text}")
                process.stdin.write(ANSWERS.get(next(known, ""), QUIT))
                process.stdin.flush()
    assert process.returncode == 0, said
    return said


@pytest.mark.long
def test_commands_run_in_their_order(tmp_path: Path) -> None:
    lines = [line for block in blocks(RECORDING, "sh") for line in block.splitlines() if line]
    outputs = [answered(line, tmp_path) for line in lines]
    record, teleop, check, info = outputs[1:5]
    assert "1 episode of transfer_cube in real-demos" in record
    assert "1 episode of transfer_cube" in teleop
    assert "1 episode, 0 problems" in check
    assert "1 real (rehearsal, no hardware)" in info
    (recording,) = DataSet(tmp_path / "real-demos").recordings()
    assert len(recording) > 30
    for output, line in zip(outputs, lines, strict=True):
        assert ("lerobot-train" in output) >= line.startswith("duobench train")


@pytest.mark.parametrize("text", [b"xk", b"xyzk"])
def test_a_pipe_is_a_terminal(text: bytes) -> None:
    reading, writing = os.pipe()
    with closing(KeyTerminal(reading)) as terminal:
        os.write(writing, text)
        os.close(writing)
        assert terminal.ask("Keep it?", "kdq") in {"k", "q"}
        assert terminal.ask("And now?", "kdq") == "q"  # nobody is there any more
    os.close(reading)


# --- evaluation ----------------------------------------------------------------------------------


def operate(page: Page) -> None:
    """Judge both trials as stage 2; one in which the page was slow comes again."""
    operator = Operator(page)
    over = threading.Event()

    def live() -> None:
        while not over.wait(0.2):
            operator.say("alive")

    living = threading.Thread(target=live)
    living.start()
    try:
        for number in (1, 2):
            while operator.until(bool)["trial"]["number"] == number:
                judge(operator)
                if operator.status["phase"] == "over":
                    break
    finally:
        over.set()
        living.join()


def must_activate(status: dict[str, Any]) -> bool:
    return any(button["id"] == ACTIVATE_BUTTON.id for button in status["panel"]["buttons"])


def judge(operator: Operator) -> None:
    operator.phase("placing")
    if operator.status["fault"]:
        operator.say("recover")
        operator.until(lambda status: not status["fault"])
    if must_activate(operator.status):
        operator.say("activate")
        operator.until(lambda status: status["phase"] == "placing" and not must_activate(status))
    status = operator.begin()
    attempt = status["trial"]["attempt"]
    operator.until(
        lambda status: status["phase"] == "judging" or status["trial"]["attempt"] > attempt
    )
    if operator.status["phase"] == "judging":
        operator.press(2)
        operator.finish()


@pytest.mark.long
def test_commands_of_an_evaluation_run(tmp_path: Path) -> None:
    said = {}
    for line in "".join(blocks(EVALUATION, "sh")).splitlines():
        name = " ".join(line.split()[1:3])
        at_page = name == "real eval"
        said[name] = attend(line, tmp_path, operate) if at_page else run(line, tmp_path)
    assert "0 of 1" in said["real eval"]
    assert "n = 1" in said["compare --mixed"]
    assert (tmp_path / "trials" / "run" / "index.html").exists()
    assert (tmp_path / "mixed" / "mixed.tex").exists()
