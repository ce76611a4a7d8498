"""A headset in a real browser, imitated by iwer: no real one has been tried."""

import ast
import math
import os
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

import duobench
from duobench.envs.duo_env import base_of
from duobench.tasks import catalog
from duobench.web.geometry import Geometry
from duobench.world.robot.cameras import CAMERAS, HEAD, HEAD_PITCH
from duobench.world.robot.workcell import FLOOR_Z
from tests.pages.driving import Operated, operated

IWER = Path(os.environ["DUOBENCH_IWER"])
# A Quest 3 whose grips are where its rays begin. Grips are measured unless a test says otherwise
# (iwer calls all of them guessed), and a space can be moved by a transform, as in the standard
# (iwer 2.5.0 takes its matrix).
WEAR = """
const layout = (side) => ({...IWER.metaQuest3.controllerConfig.layout[side],
  gripOffsetMatrix: new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])});
const controllerConfig = {...IWER.metaQuest3.controllerConfig,
  layout: {left: layout("left"), right: layout("right")}};
window.worn = new IWER.XRDevice({...IWER.metaQuest3, controllerConfig}, {stereoEnabled: true});
worn.installRuntime({forceInstall: true});
window.guessed = false;
Object.defineProperty(XRPose.prototype, "emulatedPosition", {get: () => window.guessed});
const offset = XRReferenceSpace.prototype.getOffsetReferenceSpace;
XRReferenceSpace.prototype.getOffsetReferenceSpace = function (transform) {
  return offset.call(this, transform.matrix);
};
"""
HEADING = math.radians(30)
ROOM_HEAD = np.array([1.0, 1.5, -2.0])
# In the room y points up; with a heading of zero one looks along -z.
ROOM_FROM_WORLD = Rotation.from_euler("y", HEADING) * Rotation.from_matrix(
    [[0, -1, 0], [0, 0, 1], [-1, 0, 0]]
)
LOOK = Rotation.from_euler("YX", [HEADING, -HEAD_PITCH])


@pytest.fixture
def page() -> Iterator[Operated]:
    with operated(IWER, WEAR) as page:
        page.open()
        place(page, "worn", ROOM_HEAD, LOOK)
        page.drive()
        yield page
        assert page.complaints == []


def place(page: Operated, part: str, position: np.ndarray, turn: Rotation) -> None:
    """Put the headset or a controller at a pose in the room."""
    page.page.evaluate(
        f"([p, q]) => {{ {part}.position.set(...p); {part}.quaternion.set(...q); }}",
        [[float(value) for value in position], [float(value) for value in turn.as_quat()]],
    )


def in_room(position: Any) -> np.ndarray:
    """A position of the world in the room, with the viewer where the robot's head is."""
    return ROOM_HEAD + ROOM_FROM_WORLD.apply(np.array(position) - CAMERAS[HEAD].pose.translation)


def enter(page: Operated, name: str = "VR") -> None:
    page.page.get_by_role("button", name=f"Enter {name}").click()
    page.wait(lambda: page.page.evaluate("eyes.length") > 2)
    page.settle()


def press(page: Operated, side: str, button: str, value: float) -> dict[str, Any]:
    page.page.evaluate(
        f"worn.controllers.{side}.updateButtonValue({button!r}, {value})",
    )
    return page.settle()


def matrices(page: Operated) -> tuple[np.ndarray, np.ndarray]:
    """Poses in the world from which the two eyes saw the scene last."""
    page.settle()
    views = page.page.evaluate("eyes.slice(-2).map((eye) => eye[0])")
    left, right = (np.linalg.inv(np.array(view).reshape(4, 4).T) for view in views)
    return left, right


def test_the_viewer_sees_what_the_robots_head_camera_sees(page: Operated) -> None:
    enter(page)
    left, right = matrices(page)
    np.testing.assert_allclose(
        (left[:3, 3] + right[:3, 3]) / 2, CAMERAS[HEAD].pose.translation, atol=1e-5
    )
    np.testing.assert_allclose(left[:3, :3], CAMERAS[HEAD].pose.rotation, atol=1e-5)
    assert left[1, 3] - right[1, 3] == pytest.approx(0.063, abs=0.005)  # between the eyes
    ports = page.page.evaluate("eyes.slice(-2).map((eye) => eye[2])")
    assert ports == [[0, 0, 500, 800], [500, 0, 500, 800]]


def test_controllers_are_hands_in_the_frame_of_the_table(page: Operated) -> None:
    turns = {"left": Rotation.identity(), "right": Rotation.from_rotvec([0, 0, 0.7])}
    places = {"left": [0.4, 0.25, 0.3], "right": [0.5, -0.2, 0.15]}
    for side, turn in turns.items():
        place(page, f"worn.controllers.{side}", in_room(places[side]), ROOM_FROM_WORLD * turn)
    enter(page)
    now = page.settle()
    for side, turn in turns.items():
        np.testing.assert_allclose(now[side]["pose"][:3], places[side], atol=1e-5)
        w, x, y, z = now[side]["pose"][3:]
        assert (Rotation.from_quat([x, y, z, w]) * turn.inv()).magnitude() < 1e-4
        assert now[side]["sure"]
    page.page.evaluate("window.guessed = true")
    assert not page.settle()["left"]["sure"]
    page.page.evaluate("worn.controllers.left.connected = false")
    page.wait(lambda: page.settle()["left"] is None)
    assert page.settle()["right"] is not None


def test_buttons_are_those_of_the_standard_mapping(page: Operated) -> None:
    enter(page)
    assert press(page, "left", "squeeze", 1)["left"]["squeeze"] == 1
    assert press(page, "left", "trigger", 0.3)["left"]["trigger"] == pytest.approx(0.3)
    assert press(page, "left", "squeeze", 0)["left"]["squeeze"] == 0
    assert page.hands()[-3]["devices"] == ["headset"]  # the trigger
    press(page, "left", "trigger", 0)
    assert page.settle()["devices"] == []
    for side, button, name in (
        ("left", "x-button", "keep"),
        ("left", "y-button", "restore"),
        ("right", "a-button", "keep"),
        ("right", "b-button", "discard"),
    ):
        expected = {"keep": False, "discard": False, "restore": False, "recentre": False}
        assert press(page, side, button, 1)[side]["buttons"] == expected | {name: True}
        assert press(page, side, button, 0)[side]["buttons"] == expected


def test_a_click_of_the_stick_puts_the_view_anew_and_opens_the_clutch(page: Operated) -> None:
    enter(page)
    press(page, "right", "squeeze", 1)
    place(
        page,
        "worn",
        ROOM_HEAD + np.array([0.3, -0.2, 0.5]),
        Rotation.from_euler("YX", [1.0, -HEAD_PITCH]),
    )
    left, right = matrices(page)
    assert np.linalg.norm((left + right)[:3, 3] / 2 - CAMERAS[HEAD].pose.translation) > 0.5
    now = press(page, "right", "thumbstick", 1)
    assert now["right"]["buttons"]["recentre"]
    assert now["right"]["squeeze"] == 0
    left, right = matrices(page)
    np.testing.assert_allclose((left + right)[:3, 3] / 2, CAMERAS[HEAD].pose.translation, atol=1e-5)
    np.testing.assert_allclose(left[:3, :3], CAMERAS[HEAD].pose.rotation, atol=1e-5)
    press(page, "right", "thumbstick", 0)
    assert press(page, "right", "squeeze", 0.2)["right"]["squeeze"] == pytest.approx(0.2)
    assert press(page, "right", "squeeze", 1)["right"]["squeeze"] == 1


def test_a_pulse_lets_the_controller_of_its_side_rumble(page: Operated) -> None:
    page.page.evaluate(
        """() => { for (const side of ["left", "right"]) {
          const motor = worn.controllers[side].inputSource.gamepad.hapticActuators[0];
          motor.pulse = (...pulse) => (window[`shaken_${side}`] = pulse);
        } }"""
    )
    enter(page)
    page.tell(kind="pulse", side="left", strength=0.4, ms=60)
    page.wait(lambda: page.page.evaluate("window.shaken_left") == [0.4, 60])
    assert page.page.evaluate("window.shaken_right") is None


def test_a_session_that_is_hidden_or_over_moves_nothing(page: Operated) -> None:
    enter(page)
    assert press(page, "left", "squeeze", 1)["left"]["squeeze"] == 1
    page.page.evaluate("worn.updateVisibilityState('visible-blurred')")
    page.wait(lambda: page.settle()["left"] is None)
    page.page.evaluate("worn.updateVisibilityState('visible')")
    page.wait(lambda: page.settle()["left"] is not None)
    page.page.evaluate("parts.headset.leave()")
    page.wait(lambda: not page.page.evaluate("parts.headset.isWorn"))
    now = page.settle()
    assert (now["left"]["squeeze"], now["right"]["squeeze"]) == (0, 0)
    assert page.page.get_by_role("button", name="Enter VR").is_enabled()


def board(page: Operated) -> str:
    return " ".join(page.page.evaluate("parts.headset.lines"))


def hold_trigger(page: Operated, side: str, seconds: float) -> None:
    page.page.evaluate(f"worn.controllers.{side}.updateButtonValue('trigger', 1)")
    page.page.wait_for_timeout(1000 * seconds)


@pytest.mark.parametrize(("drivers", "word"), [(0, "drive"), (1, "take_over")])
def test_who_entered_without_the_role_asks_for_it_by_a_trigger(
    page: Operated, drivers: int, word: str
) -> None:
    page.tell(kind="role", role="viewer", drivers=drivers, viewers=1)
    page.page.get_by_role("button", name="Enter VR").click()
    page.wait(lambda: page.page.evaluate("eyes.length") > 2)
    wanted = "take over" if drivers else "do not drive yet"
    page.wait(lambda: wanted in board(page))
    hold_trigger(page, "left", 0.5)
    assert "■" in board(page)
    page.page.evaluate("worn.controllers.left.updateButtonValue('trigger', 0)")
    page.wait(lambda: "■" not in board(page))
    assert page.said(word) == 0
    hold_trigger(page, "right", 1.0)
    page.wait(lambda: page.said(word) == 1)
    page.drive()
    assert page.settle()["right"]["trigger"] == 0  # what asked closes no gripper
    assert "do not drive" not in board(page)
    page.tell(kind="role", role="viewer", drivers=1, viewers=1)  # while it is held on
    page.wait(lambda: "somebody else drives" in board(page))
    page.page.wait_for_timeout(1500)
    assert page.said("take_over") + page.said("drive") == 1


def test_a_cut_and_what_became_of_the_role_are_said_on_the_board(page: Operated) -> None:
    enter(page)
    press(page, "right", "squeeze", 1)
    page.page.evaluate("cut()")
    page.wait(lambda: "Connection lost" in board(page))
    page.tell(kind="role", role="driver", drivers=1, viewers=0)
    page.wait(lambda: "Connected again, and you drive" in board(page))
    page.tell(kind="status", state="recording", clutch={"left": False, "right": True})
    page.wait(lambda: "Connected" not in board(page))
    page.page.evaluate("cut()")
    page.tell(kind="role", role="viewer", drivers=1, viewers=1)
    page.wait(lambda: "somebody else drives now" in board(page))
    assert "to take over" in board(page)


SOURCE = Path(duobench.__file__).parent
LONG_WORD = "/data/demonstrations/00042.duo"
"""What may stand for a field of a sentence."""


def sentences() -> list[str]:
    """What a session of the simulation or of a rig can say, with long words where it puts others.

    Every text in their code that ends as a sentence, those of errors too: all of them can come to
    the board as a note.
    """
    found = set[str]()
    for folder in ("teleop", "real/sessions"):
        for file in sorted((SOURCE / folder).rglob("*.py")):
            tree = ast.parse(file.read_text(encoding="utf-8"))
            said = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
            parts = {
                id(part)
                for node in ast.walk(tree)
                if isinstance(node, ast.JoinedStr)
                for part in node.values
            }
            for node in ast.walk(tree):
                if id(node) in said | parts:  # documentation, or a part of another text
                    continue
                text = words_of(node)
                if " " in text and text.rstrip()[-1:] in {".", "?", "…"}:
                    found.add(" ".join(text.split()))
    return sorted(found)


def words_of(node: ast.AST) -> str:
    """Text of a literal, with a long word for each of its fields."""
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=values):
            return "".join(words_of(value) for value in values)
        case ast.FormattedValue():
            return LONG_WORD
    return ""


READ = """async ([tasks, notes]) => {
  const { Board } = await import("/board.js");
  const { Words } = await import("/words.js");
  const noGraphics = new Proxy({}, { get: () => () => ({}) }); // which only show the same again
  const board = new Board(noGraphics);
  const words = new Words();
  const pen = board.paper.getContext("2d");
  const { width, height } = board.paper;
  /** Whether a rectangle of the canvas has letters on it. */
  const isWritten = (x, y, across, down) => {
    const { data } = pen.getImageData(x, y, across, down);
    for (let i = 0; i < data.length; i += 4) if (data[i] > 100) return true;
    return false;
  };
  const wrong = [];
  let [least, count] = [Infinity, 0];
  const read = (status, more) => {
    words.status = status;
    const lines = words.onBoard(more);
    board.show(lines);
    count += 1;
    const { rows } = board;
    const last = rows.at(-1);
    least = Math.min(least, last.size);
    const isWhole = rows.map(({ row }) => row).join("").replace(/\\s/g, "") ===
      lines.join("").replace(/\\s/g, "");
    const isInside = !isWritten(0, height - 8, width, 8) && !isWritten(width - 16, 0, 16, height);
    const isThere = isWritten(0, Math.floor(last.y - last.size), width, Math.ceil(1.3 * last.size));
    if (!isWhole || !isInside || !isThere || last.y > height) wrong.push(lines);
  };
  for (const task of tasks) {
    for (const note of notes) {
      const status = { ...task, note, kept: 10, wanted: 50, discarded: 12, led_s: 175,
        clutch: {}, state: "waiting" };
      words.role = { role: "viewer", drivers: 1 };
      read(status, { asked: 0.5, ms: 1234 });
      words.role = { role: "driver", drivers: 1 };
      read(status, { isBare: true, ms: 1234 });
    }
    words.cut();
    read({ ...task, note: notes[0], state: "paused" }, {});
  }
  return { wrong, least, count };
}"""
LEAST_LETTERS = 18
"""Pixels of letters that are read on the board: half a degree high where the head is."""


@pytest.mark.slow
def test_every_note_of_every_task_is_on_the_board(page: Operated) -> None:
    notes = [*sentences(), " ".join([LONG_WORD] * 4)]
    assert "Lead a tool to begin." in notes
    assert any("mergency" in note or "held" in note for note in notes)  # of a rig
    assert len(notes) > 30
    tasks = [
        {
            "instruction": max(task.instructions, key=len),
            "next": max((stage.instruction for stage in task.stages), key=len),
            "stage": 1,
            "max_stage": task.max_stage,
        }
        for task in map(catalog.get, catalog.names())
    ]
    assert len(tasks) == 11
    found = page.page.evaluate(READ, [tasks, notes])
    assert found["count"] > 2 * len(tasks) * len(notes)
    assert found["wrong"] == []
    assert found["least"] >= LEAST_LETTERS


def test_both_sticks_hold_the_arms(page: Operated) -> None:
    enter(page)
    press(page, "left", "thumbstick", 1)
    assert page.said("hold") == 0
    press(page, "right", "thumbstick", 1)
    assert page.said("hold") == 1
    press(page, "right", "thumbstick", 0)
    press(page, "left", "thumbstick", 0)


# Hands of iwer, whose joints stand where the wrist is put; a grip is middle, ring and little finger
# of the pose that points.
BARE = """
worn.primaryInputMode = "hand";
const inner = (hand) => Object.getOwnPropertySymbols(hand)
  .map((symbol) => hand[symbol]).find((each) => each?.poses);
const at = (pose, joint) => [...pose.jointTransforms[joint].offsetMatrix.slice(12, 15)];
const holding = /^(middle|ring|pinky)/;
/** Of two poses one, with fingers of the other, its wrist in the origin. */
const mixed = (pose, other) => {
  const [here, there] = [at(pose, "wrist"), at(other, "wrist")];
  const jointTransforms = {};
  for (const joint of Object.keys(pose.jointTransforms)) {
    const [from, wrist] = holding.test(joint) ? [other, there] : [pose, here];
    const place = at(from, joint).map((value, i) => value - wrist[i]);
    const offsetMatrix = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, ...place, 1]);
    jointTransforms[joint] = { offsetMatrix, radius: 0.01 };
  }
  return { jointTransforms, gripOffsetMatrix: pose.gripOffsetMatrix };
};
const { default: open, pinch, point } = inner(worn.hands.left).poses;
const poses = {
  open: { default: mixed(open, open), pinch: mixed(pinch, pinch) },
  held: { default: mixed(open, point), pinch: mixed(pinch, point) },
};
window.shape = (side, isHeld, trigger) => {
  inner(worn.hands[side]).poses = isHeld ? poses.held : poses.open;
  worn.hands[side].updatePinchValue(trigger);
};
/** How far iwer's pinch has to go for a trigger: from 7 cm between the tips to 2 cm. */
window.pinchFor = (trigger) => {
  const between = ({ jointTransforms }) => {
    const [thumb, index] = ["thumb-tip", "index-finger-tip"].map((joint) =>
      jointTransforms[joint].offsetMatrix.slice(12, 15));
    return thumb.map((value, i) => value - index[i]);
  };
  const [apart, touching] = [between(poses.open.default), between(poses.open.pinch)];
  const length = (share) =>
    Math.hypot(...apart.map((value, i) => value * (1 - share) + touching[i] * share));
  let [low, high] = [0, 1];
  for (let i = 0; i < 40; i++) {
    const middle = (low + high) / 2;
    if (length(middle) > 0.07 - 0.05 * trigger) low = middle;
    else high = middle;
  }
  return low;
};
shape("left", false, 0);
shape("right", false, 0);
"""


def test_bare_hands_lead_hold_and_pinch(page: Operated) -> None:
    page.page.evaluate(BARE)
    enter(page)
    turn = Rotation.from_rotvec([0, 0, 0.7])
    place(page, "worn.hands.right", in_room([0.5, -0.2, 0.15]), ROOM_FROM_WORLD * turn)
    page.page.evaluate("shape('right', true, 0)")
    now = page.settle()
    np.testing.assert_allclose(now["right"]["pose"][:3], [0.5, -0.2, 0.15], atol=1e-4)
    w, x, y, z = now["right"]["pose"][3:]
    assert (Rotation.from_quat([x, y, z, w]) * turn.inv()).magnitude() < 1e-3
    assert (now["right"]["squeeze"], now["right"]["trigger"]) == (1, 0)
    assert (now["left"]["squeeze"], now["left"]["trigger"]) == (0, 0)
    page.tell(kind="status", state="waiting")
    page.wait(lambda: "little finger" in board(page))
    page.page.evaluate("shape('right', true, 1)")
    now = page.settle()
    assert (now["right"]["squeeze"], now["right"]["trigger"]) == (1, 1)
    page.page.evaluate("shape('right', true, 0.6)")
    assert 0.1 < page.settle()["right"]["trigger"] < 0.9
    page.page.evaluate("worn.hands.right.connected = false")
    page.wait(lambda: page.settle()["right"] is None)


def test_bare_hands_judge_by_a_long_pinch(page: Operated) -> None:
    page.page.evaluate(BARE)
    enter(page)
    page.page.evaluate("shape('right', false, 1)")
    page.page.wait_for_timeout(1500)
    page.tell(kind="status", state="decide")
    page.wait(lambda: "right hand keeps" in board(page))
    page.page.wait_for_timeout(1500)
    assert page.said("keep") == 0  # it was pinched before it was asked
    page.page.evaluate("shape('right', false, 0)")
    page.settle()
    page.page.evaluate("shape('right', false, 1)")
    page.wait(lambda: page.said("keep") == 1)
    page.page.evaluate("shape('right', false, 0); shape('left', false, 1)")
    page.wait(lambda: page.said("discard") == 1)
    assert page.said("keep") == 1


@pytest.fixture(scope="module")
def scene() -> dict[str, bytes]:
    """A task as it begins, as the server gives it to a page."""
    with closing(duobench.make("transfer_cube")) as env:
        env.reset(seed=0)
        simulation = base_of(env).simulation
        geometry = Geometry(simulation.model)
        poses = geometry.poses(simulation.data)
    return {"/scene.bin": geometry.data, "/poses.bin": poses.tobytes()}


@pytest.mark.parametrize("name", ["VR", "AR"])
def test_the_eyes_see_the_scene(scene: dict[str, bytes], name: str, tmp_path: Path) -> None:
    """In AR there is no room, so that what is behind the picture is seen."""
    with operated(IWER, WEAR, files=scene) as page:
        page.open()
        place(page, "worn", ROOM_HEAD, LOOK)
        page.drive()
        enter(page, name)
        page.page.screenshot(path=tmp_path / "eyes.png")
        assert page.complaints == []
    with Image.open(tmp_path / "eyes.png") as image:
        seen = np.asarray(image.convert("RGB"), int)[110:690, 110:890].reshape(-1, 3)
    is_table = (np.abs(seen - [190, 170, 145]) < 20).all(axis=1).mean()
    assert is_table > 0.1
    is_behind = (seen == 0xDD).all(axis=1).mean()  # the canvas is grey
    assert is_behind > 0.1 if name == "AR" else is_behind < 0.001


def test_a_table_is_placed_by_pointing_pressing_and_turning(page: Operated) -> None:
    """Nothing but the floor is known of the room: the table is as high as the robot's."""

    def point(position: np.ndarray) -> None:
        """Let the ray of the right controller go through a point of the room."""
        start = np.array([0.0, 1.3, 0.0])
        away = (position - start) / np.linalg.norm(position - start)
        heading, pitch = math.atan2(-away[0], -away[2]), math.asin(away[1])
        turn = Rotation.from_euler("YX", [heading, pitch])
        place(page, "worn.controllers.right", start, turn)

    place(page, "worn", np.array([0.0, 1.6, 0.0]), Rotation.identity())
    origin, ahead = np.array([0.2, -FLOOR_Z, -0.5]), np.array([0.8, -FLOOR_Z, -0.5])
    point(origin)
    enter(page, "AR")
    assert page.settle()["right"] is None
    press(page, "right", "trigger", 1)
    point(ahead)
    page.settle()
    press(page, "right", "trigger", 0)
    page.wait(lambda: page.settle()["right"] is not None)
    left, right = matrices(page)
    # x of the world now points along x of the room, z up, and so y along -z of the room.
    room_from_world = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    expected = room_from_world.T @ (np.array([0.0, 1.6, 0.0]) - origin)
    np.testing.assert_allclose((left + right)[:3, 3] / 2, expected, atol=1e-4)
    np.testing.assert_allclose(left[:3, :3], room_from_world.T, atol=1e-4)
    place(page, "worn.controllers.right", origin, Rotation.identity())
    np.testing.assert_allclose(page.settle()["right"]["pose"][:3], [0, 0, 0], atol=1e-4)


def test_a_page_without_webxr_says_why() -> None:
    with operated("delete Navigator.prototype.xr;") as page:
        page.open()
        text = page.page.get_by_role("status")
        page.wait(lambda: "WebXR" in text.inner_text())
        assert page.page.get_by_role("button", name="Enter VR").count() == 0
        page.page.evaluate("Object.defineProperty(window, 'isSecureContext', {value: false})")
        reason = page.page.evaluate(
            "import('/headset.js').then((part) => part.support()).then((found) => found.reason)"
        )
        assert "plain http" in reason
