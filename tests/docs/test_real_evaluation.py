"""The page on evaluating on real arms: its commands run, with a scripted operator."""

import threading
from inspect import signature
from pathlib import Path

import pytest

from duobench.rig_sessions.cameras import FILM_RATE
from duobench.rig_sessions.status_page import SILENCE_S
from duobench.rig_sessions.trials import TrialsSession
from tests.docs.markdown import DOCS, attend, blocks, run, text_of
from tests.rig_sessions.operator import Operator
from tests.web.pages import Page

PAGE = DOCS / "real_evaluation.md"


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


def judge(operator: Operator) -> None:
    operator.phase("placing")
    if operator.status["fault"]:
        operator.say("recover")
        operator.until(lambda status: not status["fault"])
    status = operator.begin()
    attempt = status["trial"]["attempt"]
    operator.until(
        lambda status: status["phase"] == "judging" or status["trial"]["attempt"] > attempt
    )
    if operator.status["phase"] == "judging":
        operator.press(2)
        operator.finish()


@pytest.mark.slow
def test_commands_run(tmp_path: Path) -> None:
    (commands,) = blocks(PAGE, "sh")
    said = {}
    for line in commands.splitlines():
        name = " ".join(line.split()[1:3])
        at_page = name == "real eval"
        said[name] = attend(line, tmp_path, operate) if at_page else run(line, tmp_path)
    assert "0 of 1" in said["real eval"]
    assert "n = 1" in said["compare --mixed"]
    assert (tmp_path / "trials" / "run" / "index.html").exists()
    assert (tmp_path / "mixed" / "mixed.tex").exists()


def test_numbers_are_those_of_the_code() -> None:
    text = text_of(PAGE)
    assert f"no sign for {SILENCE_S:g} s" in text
    assert f"{FILM_RATE} frames a second" in text
    assert f"{signature(TrialsSession).parameters['episodes'].default} episodes a policy" in text
