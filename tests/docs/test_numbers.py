"""Numbers and names in the sentences and commands of pages are those of the code."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from inspect import signature
from pathlib import Path

import pytest

from duobench.cli.program import GROUPS, VERBS
from duobench.cli.shared.options import options_of
from duobench.core.sheets import Paper
from duobench.core.types import CONTROL_HZ
from duobench.envs.config import IMAGE_SIZE
from duobench.evaluation.replay.sources import LAYOUTS
from duobench.evaluation.replay.verify import Verdict
from duobench.evaluation.replay.viewer import MAX_ITEMS
from duobench.printing import coupon, jig, recipe
from duobench.printing.formats import BED_STEP
from duobench.real.calibration import places
from duobench.real.calibration.board import RULER_MM
from duobench.real.cell import Workspace
from duobench.real.doctor.examine import (
    LARGEST_SHIFT_PX,
    LEAST_RATE,
    LEAST_SUCCESS,
    LONGEST_ANSWER_S,
)
from duobench.real.drivers import frames, robotiq
from duobench.real.guard import FINGER_MARGIN, MARGIN, PROP_MARGIN, TABLE_DEPTH
from duobench.real.rig import (
    DAMPING_RATIOS,
    JOINT_TORQUES,
    MAX_FORCE,
    MAX_TOOL_SPEED,
    ArmConfig,
    CameraDriver,
    GripperConfig,
)
from duobench.real.sessions.cameras import FILM_RATE
from duobench.real.sessions.status_page import SILENCE_S
from duobench.real.sessions.trials import TrialsSession
from duobench.real.watchdog import STOP_AFTER_S
from duobench.results.leaderboard import EPISODES
from duobench.results.suite import Suite, find_tasks
from duobench.web.messages import MAX_MESSAGE
from duobench.web.server import MAX_PEERS
from duobench.world.objects import chest, hexagon_peg, joint_blocks, shapes
from duobench.world.robot.workcell import FLOOR_Z
from duobench.world.scene.compose import SUBSTEPS
from duobench.world.sim.placement import REACH_X, REACH_Y
from tests.docs.markdown import PAGES, page_of, table, text_of


def percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def mm(*metres: float) -> str:
    return " to ".join(f"{1000 * each:g}" for each in metres)


SENTENCES: Mapping[str, Sequence[str]] = {
    "evaluation": (f"episodes 0 to {Suite(tasks=find_tasks(())).indices[-1]}.",),
    "frames": (
        f"the floor z = {FLOOR_Z:.4f}",
        f"at x {REACH_X[0]} to {REACH_X[1]} and y {REACH_Y[0]} to {REACH_Y[1]}",
        f"1/{CONTROL_HZ:g} s: {SUBSTEPS} physics steps of 1/{CONTROL_HZ * SUBSTEPS:.0f} s",
        f"the default {IMAGE_SIZE[0]} × {IMAGE_SIZE[1]}",
    ),
    "leaderboard": (f"episodes 0 to {EPISODES - 1} of each", f"--episodes {EPISODES} "),
    "printing": (
        "1240 kg/m³",
        f"{1e9 * recipe.MATERIAL_PER_SECOND:.0f} mm³ a second",
        f"{percent(recipe.WASTE - 1)} is added",
        f"{percent(recipe.SPARSE)} of the rest",
        f"± {percent(recipe.TOLERANCE)}",
        f"{1000 * BED_STEP:.1f} mm apart",
        f"{mm(*coupon.HEXAGON_PLAYS[::4])} mm of play",
        f"{mm(*coupon.SQUARE_PLAYS[::4])} mm;",
    ),
    "real_cameras": (
        "**Not yet tried on a camera",
        f"No image for {frames.STALE_S} s is a fault",
        f"fewer than {places.FEWEST_VIEWS} show",
        f"by more than {percent(places.LARGEST_SCALE_ERROR)}",
        f"over {1000 * places.NOTED_M:.0f} mm or {places.NOTED_DEG:.0f} degrees",
        f"from {1000 * places.REFUSED_M:.0f} mm or {places.REFUSED_DEG:.0f} degrees",
    ),
    "real_evaluation": (
        f"no sign for {SILENCE_S:g} s",
        f"{FILM_RATE} frames a second",
        f"{signature(TrialsSession).parameters['episodes'].default} episodes a policy",
    ),
    "real_safety": (
        f"keep {mm(MARGIN)} mm from each other",
        f"fingers keep {mm(FINGER_MARGIN)} mm",
        f"press {mm(TABLE_DEPTH)} mm on the table",
        f"arms and hands keep {mm(PROP_MARGIN)} mm from it",
        f"after {STOP_AFTER_S:g} s",
        "tried on an arm yet",
    ),
    "real_arms": (
        "Not yet tried on an arm.",
        f"at most {MAX_TOOL_SPEED:g}: the reduced speed",
        f"at most {MAX_FORCE:g} |",
        f"what the joint gives: {JOINT_TORQUES[0]} for four, {JOINT_TORQUES[-1]} for three",
        f"{DAMPING_RATIOS[0]} to {DAMPING_RATIOS[1]} times 2 √stiffness",
        f"x {Workspace().low[0]} to {Workspace().high[0]}, y ±{Workspace().high[1]}",
    ),
    "real_setup": (
        f"at about {GripperConfig().newtons:.0f} N",
        f"tools at {ArmConfig().tool_speed} m/s",
        "**Not yet tried on an arm",
        f"No answer for {robotiq.SILENT_S} s is a fault",
        f"less than {percent(LEAST_SUCCESS)}",
        f"at less than {percent(LEAST_RATE)}",
        f"more than {LARGEST_SHIFT_PX:g} px",
        f"answers take {1000 * LONGEST_ANSWER_S:.0f} ms",
        f"its front edge is the line x = {mm(jig.LINE)} mm",
        f"feet of {mm(*jig.ACROSS)} mm with the edge {mm(*jig.FRONT)} mm in front",
        f"the simulated one, {mm(jig.Foot().front)} and {mm(jig.Foot().width)}.",
        f"x from its edge plus {mm(jig.LINE)} mm",
    ),
    "viewing": (
        f"any of {LAYOUTS} layouts",
        f"{MAX_MESSAGE:,} bytes",
        f"{MAX_PEERS} browsers",
        f"at most {MAX_ITEMS} episodes",
    ),
}
SIZES = {
    "edge of the printer": shapes.PRINTER,
    "corner of the bed that stays free, width": shapes.KEPT_FREE[0],
    "corner of the bed that stays free, depth": shapes.KEPT_FREE[1],
    "thinnest wall": shapes.THINNEST_WALL,
    "play of a glued joint": shapes.JOINT_PLAY,
    "overlap": shapes.OVERLAP,
    "play of a square peg": joint_blocks.CLEARANCE,
    "play of the hexagonal peg": hexagon_peg.CLEARANCE,
    "hole in a lug": 2 * chest.HOLE_RADIUS,
    "hole in the barrel": 2 * chest.THREAD_RADIUS,
    "play between lid and box": chest.GAP,
    "play between a post and the open lid": chest.POST_PLAY,
}


@pytest.mark.parametrize(
    ("page", "words"), [(page, words) for page, all_of in SENTENCES.items() for words in all_of]
)
def test_a_page_says_what_the_code_says(page: str, words: str) -> None:
    assert words in " ".join(text_of(page_of(page)).split())


def test_tables_have_what_the_code_has() -> None:
    sizes = {row["size"]: row["mm"] for row in table(page_of("printing"), "size")}
    assert sizes == {**sizes, **{name: mm(value) for name, value in SIZES.items()}}
    verdicts = [row["verdict"] for row in table(page_of("verification"), "verdict")]
    assert verdicts == list(Verdict)
    heading = "driver in the rig's file"
    drivers = {row[heading] for row in table(page_of("real_cameras"), heading)}
    assert drivers == set(map(str, CameraDriver))


def test_numbers_that_pages_round_are_what_they_say() -> None:
    assert coupon.HEXAGON_PLAYS[2] == hexagon_peg.CLEARANCE
    assert coupon.SQUARE_PLAYS[2] == joint_blocks.CLEARANCE
    assert RULER_MM[Paper.A4] == 200.0


# --- commands ------------------------------------------------------------------------------------


def commands() -> Iterator[tuple[str, str]]:
    """Every command that a page shows on a line of its own, and the page."""
    for page in PAGES:
        for line in text_of(page).replace("\\\n", " ").splitlines():
            if line.startswith("duobench "):
                yield page.name, line


def found(words: Sequence[str]) -> Callable[..., None]:
    verbs = VERBS
    for number, word in enumerate(words):
        verb, name = verbs[word], " ".join(words[: number + 1])
        if name not in GROUPS:
            return verb
        verbs = GROUPS[name]
    raise AssertionError(f"{words} needs a verb")


def flags(verb: Callable[..., None]) -> set[str]:
    return {each.flag for each in options_of(verb) if "Positional" not in str(each.kind)}


@pytest.mark.parametrize(("page", "line"), sorted(set(commands())))
def test_every_command_of_a_page_has_a_verb_and_options_that_exist(page: str, line: str) -> None:
    del page
    words = shlex.split(line, comments=True)[1:]
    own = words[: words.index("--")] if "--" in words else words
    named = {word.partition("=")[0] for word in own if word.startswith("--")}
    assert named <= flags(found(words))


@pytest.mark.parametrize(
    "page",
    [page_of(name) for name in ("commands", "evaluation", "policies")],
    ids=Path.__str__,
)
def test_options_that_sentences_name_exist(page: Path) -> None:
    verbs = ("eval", "record", "replay", "report", "train", "view")
    known = {flag for verb in verbs for flag in flags(VERBS[verb])}
    named = set(re.findall(r"`(--[a-z-]+)", text_of(page)))
    assert named
    assert named <= known
