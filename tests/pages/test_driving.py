"""Mouse, keys and gamepad: synthetic events of a real browser give the right hands."""

import json
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.pages.driving import Operated, operated
from tests.pages.windows import broken_rules

METRES_A_PIXEL = 2 * 2.0 * math.tan(0.5) / 600  # two metres away, half a radian above the middle
MIDDLE = (400, 300)
PAD = """
window.pad = {mapping: "standard", axes: [0, 0, 0, 0], buttons: Array.from({length: 17},
  () => ({pressed: false, value: 0})), vibrationActuator: {playEffect(name, effect) {
    window.shaken = effect; return Promise.resolve("complete"); }}};
navigator.getGamepads = () => [null, window.pad];
window.push = (button, value) => { pad.buttons[button] = {pressed: value > 0.5, value}; };
"""


@pytest.fixture(scope="module")
def page() -> Iterator[Operated]:
    with operated(PAD) as page:
        page.open()
        yield page
        assert page.complaints == []


@pytest.fixture(autouse=True)
def _driver(page: Operated) -> Iterator[None]:
    page.drive()
    page.page.keyboard.press("2")
    yield
    page.tell(kind="role", role="viewer", drivers=0, viewers=1)


@pytest.fixture
def canvas(page: Operated) -> tuple[float, float]:
    """Middle of the scene on the page."""
    scene = page.page.locator("canvas")
    scene.scroll_into_view_if_needed()
    box = scene.bounding_box()
    assert box
    return box["x"] + MIDDLE[0], box["y"] + MIDDLE[1]


def drag(page: Operated, canvas: tuple[float, float], across: int, down: int) -> int:
    """Drag from the middle; return the number of the first message."""
    start = len(page.hands())
    mouse = page.page.mouse
    mouse.move(*canvas)
    mouse.down()
    mouse.move(canvas[0] + across, canvas[1] + down, steps=10)
    page.settle()
    mouse.up()
    assert page.settle()["right"]["squeeze"] == 0
    return start


def moved(page: Operated, act: Callable[[], object]) -> tuple[list[float], list[dict[str, Any]]]:
    """How the right hand moves by what is done, once it has let go again, and its samples."""
    start = len(page.hands())
    act()
    page.wait(lambda: page.settle()["right"]["squeeze"] == 0)
    return page.motion("right", start)


def pressed(page: Operated, key: str) -> tuple[list[float], list[dict[str, Any]]]:
    return moved(page, lambda: page.page.keyboard.press(key))


def turned(samples: list[dict[str, Any]]) -> np.ndarray:
    """How a squeezed hand has turned, as a rotation vector in the world."""
    first, last = (Rotation.from_quat(samples[i]["pose"][3:], scalar_first=True) for i in (0, -1))
    return (last * first.inv()).as_rotvec()


def test_a_viewer_sends_nothing(page: Operated, canvas: tuple[float, float]) -> None:
    page.tell(kind="role", role="viewer", drivers=1, viewers=1)
    page.page.wait_for_timeout(100)
    count = len(page.messages)
    page.page.mouse.click(*canvas)
    page.page.keyboard.press("Enter")
    page.page.wait_for_timeout(200)
    assert len(page.messages) == count


def test_messages_are_numbered_and_at_most_60_a_second(page: Operated) -> None:
    start = len(page.hands())
    page.page.wait_for_timeout(1500)
    sent = [(message["seq"], message["sent"]) for message in page.hands()[start:]]
    assert [seq for seq, _ in sent] == list(range(sent[0][0], sent[0][0] + len(sent)))
    assert len(sent) > 10
    assert (len(sent) - 2) / (sent[-1][1] - sent[0][1]) <= 60 / 1000


def test_a_drag_moves_the_active_tool_in_the_plane_of_the_view(
    page: Operated, canvas: tuple[float, float]
) -> None:
    start = drag(page, canvas, 120, -60)
    shift, samples = page.motion("right", start)
    expected = [0, -120 * METRES_A_PIXEL, 60 * METRES_A_PIXEL]
    np.testing.assert_allclose(shift, expected, atol=1e-6)
    assert all(message["left"]["squeeze"] == 0 for message in page.hands()[start:])
    assert {sample["squeeze"] for sample in samples} == {1}


def test_a_drag_is_measured_at_the_depth_of_the_tool(
    page: Operated, canvas: tuple[float, float]
) -> None:
    page.tell(kind="status", tools={"left": [0.45, 0, 0], "right": [-0.55, 0.2, 0.3]})
    page.settle()
    shift, _ = page.motion("right", drag(page, canvas, 100, 0))
    np.testing.assert_allclose(shift, [0, -100 * METRES_A_PIXEL / 2, 0], atol=1e-6)
    page.tell(kind="status", tools={})


def test_a_drag_too_quick_for_a_message_is_not_lost(
    page: Operated, canvas: tuple[float, float]
) -> None:
    start = len(page.hands())
    page.page.evaluate(
        """([x, y]) => {
          const canvas = document.querySelector("canvas");
          canvas.setPointerCapture = () => {};
          const send = (type, more) => canvas.dispatchEvent(new PointerEvent(type,
            {bubbles: true, pointerType: "mouse", button: 0, clientX: x, clientY: y, ...more}));
          send("pointerdown"); send("pointermove", {clientX: x + 30}); send("pointerup");
        }""",
        list(canvas),
    )
    page.settle()
    shift, samples = page.motion("right", start)
    np.testing.assert_allclose(shift, [0, -30 * METRES_A_PIXEL, 0], atol=1e-6)
    assert len(samples) == 2
    assert page.hands()[-1]["right"]["squeeze"] == 0


def test_a_finger_moves_no_arm(page: Operated, canvas: tuple[float, float]) -> None:
    start = len(page.hands())
    page.page.evaluate(
        """([x, y]) => {
          const send = (type, clientX) => document.querySelector("canvas").dispatchEvent(
            new PointerEvent(type, {bubbles: true, pointerType: "touch", clientX, clientY: y}));
          send("pointerdown", x); send("pointermove", x + 30); send("pointerup", x + 30);
        }""",
        list(canvas),
    )
    page.settle()
    assert not any(message["right"]["squeeze"] for message in page.hands()[start:])


def test_ctrl_and_the_wheel_move_it_away_and_back(
    page: Operated, canvas: tuple[float, float]
) -> None:
    page.page.keyboard.down("Control")
    start = drag(page, canvas, 0, -50)
    page.page.keyboard.up("Control")
    np.testing.assert_allclose(
        page.motion("right", start)[0], [50 * METRES_A_PIXEL, 0, 0], atol=1e-6
    )
    shift, _ = moved(page, lambda: page.page.mouse.wheel(0, 100))
    np.testing.assert_allclose(shift, [-0.02, 0, 0], atol=1e-6)


def test_shift_turns_it_as_a_ball(page: Operated, canvas: tuple[float, float]) -> None:
    page.page.keyboard.down("Shift")
    start = drag(page, canvas, 100, 0)
    page.page.keyboard.up("Shift")
    shift, samples = page.motion("right", start)
    assert shift == [0, 0, 0]
    first, last = (np.array(samples[i]["pose"][3:]) for i in (0, -1))
    assert np.linalg.norm(last) == pytest.approx(1)
    assert abs(first @ last) == pytest.approx(math.cos(0.25))  # half of 100 times 0.005


@pytest.mark.parametrize("sideways", [False, True], ids=["wheel", "as browsers say it"])
def test_shift_and_the_wheel_turn_it_about_the_line_of_sight(
    page: Operated, canvas: tuple[float, float], sideways: bool
) -> None:
    page.page.mouse.click(*canvas)
    page.page.keyboard.down("Shift")
    wheel = (100, 0) if sideways else (0, 100)
    shift, samples = moved(page, lambda: page.page.mouse.wheel(*wheel))
    page.page.keyboard.up("Shift")
    assert shift == [0, 0, 0]
    np.testing.assert_allclose(turned(samples), [0.05, 0, 0], atol=1e-9)  # the camera looks along x


def test_c_makes_every_motion_a_quarter(page: Operated, canvas: tuple[float, float]) -> None:
    page.page.mouse.click(*canvas)
    page.page.keyboard.down("c")
    shift, _ = page.motion("right", drag(page, canvas, 100, 0))
    np.testing.assert_allclose(shift, [0, -25 * METRES_A_PIXEL, 0], atol=1e-6)
    np.testing.assert_allclose(pressed(page, "PageUp")[0], [0, 0, 0.00125], atol=1e-9)
    shift, _ = moved(page, lambda: page.page.mouse.wheel(0, 100))
    np.testing.assert_allclose(shift, [-0.005, 0, 0], atol=1e-6)
    page.page.keyboard.up("c")
    shift, _ = page.motion("right", drag(page, canvas, 100, 0))
    np.testing.assert_allclose(shift, [0, -100 * METRES_A_PIXEL, 0], atol=1e-6)


def test_q_and_e_turn_it_about_the_vertical(page: Operated, canvas: tuple[float, float]) -> None:
    page.page.mouse.click(*canvas)
    for key, angle in (("q", 0.05), ("E", -0.05)):
        shift, samples = pressed(page, key)
        assert shift == [0, 0, 0]
        np.testing.assert_allclose(turned(samples), [0, 0, angle], atol=1e-9)


def test_keys_choose_the_arm_and_the_grippers(page: Operated, canvas: tuple[float, float]) -> None:
    page.page.mouse.click(*canvas)
    left_arm = page.page.get_by_role("button", name="Left arm")
    page.page.keyboard.press("Tab")
    assert left_arm.get_attribute("aria-pressed") == "true"
    page.page.keyboard.press("2")
    assert left_arm.get_attribute("aria-pressed") == "false"
    assert page.settle()["left"]["trigger"] == 0
    page.page.keyboard.press("g")
    now = page.settle()
    assert (now["left"]["trigger"], now["right"]["trigger"]) == (1, 0)
    assert (now["left"]["squeeze"], now["right"]["squeeze"]) == (0, 0)
    page.page.keyboard.press("g")
    assert page.settle()["left"]["trigger"] == 0
    page.page.keyboard.down("j")
    page.page.wait_for_timeout(400)
    assert page.settle()["right"]["trigger"] == 1
    page.page.keyboard.up("j")
    assert page.settle()["right"]["trigger"] == 0
    for key, trigger in (("c", 0.25), ("c", 0.5), ("Shift", 0.25), ("c", 0.5)):  # by a quarter
        page.page.keyboard.down(key)
        page.page.keyboard.press("j")
        page.page.keyboard.up(key)
        assert page.settle()["right"]["trigger"] == trigger
    page.tell(kind="status", state="over")
    page.tell(kind="status", state="waiting")
    page.wait(lambda: page.settle()["right"]["trigger"] == 0)


def test_grippers_are_open_when_an_episode_waits(
    page: Operated, canvas: tuple[float, float]
) -> None:
    page.page.mouse.click(*canvas)
    page.page.keyboard.press("j")
    page.tell(kind="status", state="success")
    assert page.settle()["right"]["trigger"] == 1
    page.tell(kind="status", state="waiting")
    page.wait(lambda: page.settle()["right"]["trigger"] == 0)


def test_keys_move_by_a_step_and_go_on_while_held(
    page: Operated, canvas: tuple[float, float]
) -> None:
    page.page.mouse.click(*canvas)
    for key, expected in (
        ("ArrowUp", [0.005, 0, 0]),
        ("ArrowLeft", [0, 0.005, 0]),
        ("PageUp", [0, 0, 0.005]),
        ("PageDown", [0, 0, -0.005]),
    ):
        np.testing.assert_allclose(pressed(page, key)[0], expected, atol=1e-9)

    def hold() -> None:
        page.page.keyboard.down("ArrowRight")
        page.page.wait_for_timeout(1000)
        page.page.keyboard.up("ArrowRight")

    shift, _ = moved(page, hold)
    assert -0.3 < shift[1] < -0.05


WORDS = ("keep", "discard", "restore")
KEYS = "1234567890-=qwertuiop[]asdfghjkl;'zxcvbnm,./ ".replace("p", "")
"""What types a character, without the two that decide."""
OTHERS = ("Tab", "Home", "End", "Insert", "Delete", "PageUp", "PageDown", "ArrowUp", "F9")


def said(page: Operated) -> list[int]:
    return [page.said(word) for word in WORDS]


def test_keep_discard_and_restore_are_said_once(
    page: Operated, canvas: tuple[float, float]
) -> None:
    page.page.mouse.click(*canvas)
    before = said(page)
    for key in ("Enter", "Backspace", "p"):
        page.page.keyboard.press(key)
    for button in (9, 8, 3):
        page.page.evaluate(f"push({button}, 1)")
        page.settle()
        page.page.evaluate(f"push({button}, 0)")
        page.settle()
    assert said(page) == [count + 2 for count in before]
    page.page.keyboard.press("r")
    page.wait(lambda: page.said("alone") == 1)


def test_no_other_key_and_no_other_button_decides(
    page: Operated, canvas: tuple[float, float]
) -> None:
    page.page.mouse.click(*canvas)
    before = said(page)
    for key in (*KEYS, *KEYS.upper(), *OTHERS):
        page.page.keyboard.press(key)
    page.page.mouse.click(*canvas)
    for button in sorted(set(range(17)) - {3, 8, 9}):
        page.page.evaluate(f"push({button}, 1)")
        page.settle()
        page.page.evaluate(f"push({button}, 0)")
    page.settle()
    assert said(page) == before


def led_by(page: Operated, start: int) -> set[str]:
    page.settle()
    return {device for message in page.hands()[start:] for device in message["devices"]}


def test_messages_say_what_led(page: Operated, canvas: tuple[float, float]) -> None:
    page.page.mouse.click(*canvas)
    page.settle()
    start = len(page.hands())
    assert led_by(page, start) == set()
    start = drag(page, canvas, 20, 0)
    assert led_by(page, start) == {"mouse"}
    for key in ("ArrowUp", "g", "g"):
        start = len(page.hands())
        page.page.keyboard.press(key)
        assert led_by(page, start) == {"mouse"}
        page.wait(lambda: page.hands()[-1]["right"]["squeeze"] == 0)  # a tap is led to its end
    for act in ("pad.axes = [0, -1, 0, 0]", "pad.axes = [0, 0, 0, 0]; push(7, 0.4)", "push(7, 0)"):
        start = len(page.hands())
        page.page.evaluate(act)
        assert led_by(page, start) == {"gamepad"}
    page.settle()
    start = len(page.hands())
    assert led_by(page, start) == set()


def test_keys_are_no_trap_and_other_parts_of_the_page_keep_theirs(
    page: Operated, canvas: tuple[float, float]
) -> None:
    page.page.mouse.click(*canvas)
    page.page.keyboard.press("Escape")
    page.page.keyboard.press("Tab")
    assert page.page.evaluate("document.activeElement.tagName") == "BUTTON"
    before = page.said("keep")
    page.page.keyboard.press("Enter")
    page.settle()
    assert page.said("keep") == before


def test_a_stalled_page_lets_go(page: Operated, canvas: tuple[float, float]) -> None:
    page.page.mouse.move(*canvas)
    page.page.mouse.down()
    assert page.settle()["right"]["squeeze"] == 1
    page.page.evaluate("const end = performance.now() + 500; while (performance.now() < end);")
    page.page.mouse.move(canvas[0] + 50, canvas[1])
    now = page.settle()
    assert now["right"]["squeeze"] == 0
    page.page.mouse.up()
    shift, _ = page.motion("right", drag(page, canvas, 10, 0))
    np.testing.assert_allclose(shift, [0, -10 * METRES_A_PIXEL, 0], atol=1e-6)


def test_a_gamepad_moves_the_arm_that_its_bumpers_choose(page: Operated) -> None:
    page.page.evaluate("push(4, 1)")
    page.settle()
    page.page.evaluate("push(4, 0)")
    start = len(page.hands())
    page.page.evaluate("pad.axes = [0, -1, 0, 0.1]")
    page.page.wait_for_timeout(600)
    page.page.evaluate("pad.axes = [0, 0, 0, 0]")
    page.settle()
    shift, samples = page.motion("left", start)
    squeezed = [message for message in page.hands()[start:] if message["left"]["squeeze"]]
    seconds = (squeezed[-1]["sent"] - squeezed[0]["sent"]) / 1000
    assert shift[0] == pytest.approx(0.25 * seconds, rel=0.1)
    assert shift[1:] == pytest.approx([0, 0])
    assert len({json.dumps(sample["pose"][3:]) for sample in samples}) == 1
    page.page.evaluate("push(7, 0.4)")
    assert page.settle()["right"]["trigger"] == 0.4
    page.page.evaluate("push(7, 0)")
    page.tell(kind="pulse", side="left", strength=0.5, ms=80)
    page.wait(lambda: page.page.evaluate("window.shaken?.duration") == 80)


TOOLS = {"left": [0.45, 0.2, 0.1], "right": [0.45, -0.1, 0.1]}
MIDDLE_Y = 0.05


def both(page: Operated, *, mirrored: bool) -> None:
    """Let one pointer lead both tools, which are where the tests say."""
    page.tell(kind="status", tools=TOOLS)
    page.page.keyboard.press("3")
    button = page.page.get_by_role("button", name="Mirrored")
    if (button.get_attribute("aria-pressed") == "true") != mirrored:
        page.page.keyboard.press("m")
    assert button.get_attribute("aria-pressed") == str(mirrored).lower()
    page.settle()


def motions(page: Operated, key: str) -> dict[str, tuple[list[float], np.ndarray]]:
    """How far both hands move, and how they turn, by a tap of a key."""
    start = len(page.hands())
    page.page.keyboard.press(key)
    page.wait(lambda: page.settle()["right"]["squeeze"] == 0)
    found = {}
    for side in ("left", "right"):
        shift, samples = page.motion(side, start)
        found[side] = (shift, turned(samples))
    return found


def test_one_pointer_leads_both_tools_mirrored(page: Operated, canvas: tuple[float, float]) -> None:
    page.page.mouse.click(*canvas)
    both(page, mirrored=True)
    start = drag(page, canvas, 60, -40)
    right, _ = page.motion("right", start)
    left, _ = page.motion("left", start)
    assert right[1] < -0.05 < 0.05 < right[2]
    np.testing.assert_allclose(left, [right[0], -right[1], right[2]], atol=1e-9)
    found = motions(page, "q")
    np.testing.assert_allclose(found["right"][1], [0, 0, 0.05], atol=1e-9)
    np.testing.assert_allclose(found["left"][1], [0, 0, -0.05], atol=1e-9)
    assert found["left"][0] == found["right"][0] == [0, 0, 0]


def test_both_tools_go_as_if_they_held_one_thing(
    page: Operated, canvas: tuple[float, float]
) -> None:
    page.page.mouse.click(*canvas)
    both(page, mirrored=False)
    for key in ("ArrowLeft", "PageUp"):
        found = motions(page, key)
        np.testing.assert_allclose(found["left"][0], found["right"][0], atol=1e-9)
    page.page.keyboard.down("Shift")
    found = motions(page, "ArrowRight")  # about the vertical, so that both tools swing
    page.page.keyboard.up("Shift")
    for side, (shift, turn) in found.items():
        arm = np.array(TOOLS[side]) - [0.45, MIDDLE_Y, 0.1]
        expected = Rotation.from_rotvec(turn).apply(arm) - arm
        assert np.linalg.norm(shift) > 0.005
        np.testing.assert_allclose(shift, expected, atol=1e-9)
    page.page.keyboard.press("m")
    page.tell(kind="status", tools={})


def test_each_stick_leads_its_tool_and_with_b_both_lead_one_thing(page: Operated) -> None:
    page.tell(kind="status", tools=TOOLS)
    for button, value in ((4, 1), (5, 1), (4, 0), (5, 0)):
        page.page.evaluate(f"push({button}, {value})")
        page.settle()
    pressed = page.page.get_by_role("button", name="Both arms")
    assert pressed.get_attribute("aria-pressed") == "true"

    def pushed(*axes: float, held: int | None = None) -> list[list[float]]:
        """How far both tools go by the sticks."""
        if held is not None:
            page.page.evaluate(f"push({held}, 1)")
        page.settle()
        start = len(page.hands())
        page.page.evaluate(f"pad.axes = {list(axes)}")
        page.page.wait_for_timeout(300)
        page.page.evaluate("pad.axes = [0, 0, 0, 0]")
        page.settle()
        if held is not None:
            page.page.evaluate(f"push({held}, 0)")
        squeezed = {message["seq"]: message for message in page.hands()[start:]}
        poses = [
            [message[side]["pose"][:3] for message in squeezed.values()]
            for side in ("left", "right")
        ]
        return [
            [last - first for first, last in zip(each[0], each[-1], strict=True)] for each in poses
        ]

    left, right = pushed(0, -1, 0, 0)
    assert left[0] > 0.02
    assert right == [0, 0, 0]
    left, right = pushed(0, 0, 0, 1)
    assert right[0] < -0.02
    assert left == [0, 0, 0]
    left, right = pushed(0, -1, 0, 1, held=0)  # with A: up and down
    assert left[2] > 0.02
    assert right[2] < -0.02
    left, right = pushed(1, 0, 0, -1, held=1)  # with B: as one thing
    assert left[1] < -0.02
    assert left[2] > 0.02
    np.testing.assert_allclose(left, right, atol=1e-9)
    page.tell(kind="status", tools={})


def test_a_stick_leads_again_after_the_page_stood_still(page: Operated) -> None:
    """The arms demand a release after a stall, so the page says one; a held stick must rest."""
    stall = "const end = performance.now() + 500; while (performance.now() < end);"
    start = len(page.hands())
    page.page.evaluate(f"{stall} pad.axes = [0, -1, 0, 0];")
    page.page.wait_for_timeout(300)
    after = [message["right"] for message in page.hands()[start:]]
    squeezes = [hand["squeeze"] for hand in after]
    first = squeezes.index(1)
    assert squeezes[first - 1] == 0
    assert after[first]["pose"] == after[first - 1]["pose"]
    assert after[-1]["squeeze"] == 1
    page.page.evaluate(stall)
    assert page.settle()["right"]["squeeze"] == 0
    page.page.evaluate("pad.axes = [0, 0, 0, 0]")
    page.settle()
    page.page.evaluate("pad.axes = [0, -1, 0, 0]")
    assert page.settle()["right"]["squeeze"] == 1
    page.page.evaluate("pad.axes = [0, 0, 0, 0]")
    page.settle()


def test_no_rule_of_accessibility_is_broken(page: Operated) -> None:
    assert page.page.evaluate("document.querySelector('details').open")  # until it is folded
    assert broken_rules(page.page) == []


def test_the_board_says_a_latency_that_was_measured_and_no_other(page: Operated) -> None:
    status = {"kind": "status", "state": "recording", "latency_ms": 18.0, "discarded": 1}
    page.tell(**status)
    page.wait(lambda: page.page.evaluate("parts.headset.lines").count("recording") == 1)
    assert "Y asks about the last one" in " ".join(page.page.evaluate("parts.headset.lines"))
    page.page.evaluate(
        """() => { const { latency } = parts.hands; const sent = performance.now() - 250;
          latency.arrived(sent); latency.drawn((call) => call());  // of another page: none
          latency.sent(sent); latency.arrived(sent); latency.drawn((call) => call()); }"""
    )
    page.tell(**status, note="again")
    pattern = "/hand to picture 2[5-9]\\d ms/.test(parts.headset.lines.join(' '))"
    page.wait(lambda: page.page.evaluate(pattern))
    page.tell(kind="role", role="viewer", drivers=0, viewers=1)
    page.wait(lambda: page.page.evaluate("parts.hands.latency.ms") is None)
