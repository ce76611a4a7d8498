// Everything with which a person drives the arms, and the panel that says how.

import { Gamepads } from "./gamepad.js";
import { Hands } from "./hands.js";
import { Headset, support } from "./headset.js";
import { Mouse } from "./mouse.js";

const CONTROLS = {
  "Mouse, with the pointer on the scene": [
    ["Drag", "move the tool as you see it"],
    ["Ctrl and drag, or the wheel", "move it away and back"],
    ["Shift and drag, Shift and wheel", "turn it"],
    ["Drag with the right button, or Ctrl and wheel", "move the camera"],
  ],
  "Keys, while the scene is in focus": [
    ["1, 2 or Tab", "left arm, right arm, or the other one"],
    ["Arrow keys, Page Up, Page Down", "move the tool along the table, up and down"],
    ["Shift and these", "turn it"],
    ["Q, E", "turn it about the vertical"],
    ["Space", "hold both arms"],
    ["1 to 9, U", "on real arms: this stage is reached; take the latest back"],
    ["F, J", "left, right gripper: tap to close or open, hold for as long as you hold"],
    ["Y", "keep the episode"],
    ["Backspace, P", "discard it; put the last discarded one back"],
    ["+, -, 0", "camera nearer, farther, or as at first"],
    ["Escape, or Shift and Tab", "leave the scene, to reach the rest of the page"],
  ],
  Gamepad: [
    ["Left stick", "move the tool along the table"],
    ["Right stick", "up and down; sideways: turn it"],
    ["A and the sticks", "turn it about all axes"],
    ["Bumpers", "left arm, right arm"],
    ["Triggers", "left, right gripper"],
    ["Start, Back", "keep or discard the episode"],
    ["Y", "put the last discarded one back"],
  ],
  Headset: [
    ["Grip", "hold it to move the tool with your hand; let go to reach further"],
    ["Index trigger", "close the gripper, as far as you press"],
    ["A or X", "keep the episode"],
    ["B, Y", "discard it; put the last discarded one back"],
    ["Click a stick", "put the view, or the table, anew"],
  ],
};
const DRIVING = {
  role: "application",
  ariaLabel: "The table and the robot in 3D. Keys move the arms; Controls lists them.",
};
const TICK_MS = 8; // how often it is asked whether a message is due
const SIDES = ["left", "right"];
const WORN = { "immersive-vr": "Enter VR", "immersive-ar": "Enter AR" };

/** An element with attributes and children. */
function build(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

/** The list of controls, folded. */
function help() {
  const parts = Object.entries(CONTROLS).map(([device, rows]) => {
    const list = build("dl");
    for (const [what, does] of rows) list.append(build("dt", {}, what), build("dd", {}, does));
    return build("section", {}, build("h2", {}, device), list);
  });
  return build("details", { class: "help" }, build("summary", {}, "Controls"), ...parts);
}

const HINTS = {
  waiting: "Hold a grip: its arm follows your hand. The trigger closes the gripper.",
  decide: "A or X keeps the episode, B discards it.",
};

/** What the board in the scene says of a status of the server. */
function lines({ instruction, next, stage, max_stage, state, kept, wanted, discarded, panel }, ms) {
  const said = (value) => value !== undefined && value !== null;
  const facts = [
    said(stage) && said(max_stage) && `stage ${stage} of ${max_stage}`,
    state,
    said(kept) && (said(wanted) ? `${kept} of ${wanted} kept` : `${kept} kept`),
    said(ms) && `hand to picture ${Math.round(ms)} ms`,
  ];
  const line = facts.filter(Boolean).join(" · ");
  const bin = discarded > 0 && `${discarded} discarded; Y puts the last one back.`;
  const step = panel && `${panel.now + 1} ${panel.title}: ${panel.todo || HINTS[state] || ""}`;
  return [instruction, next && `Next: ${next}`, line, step ?? HINTS[state], bin].filter(Boolean);
}

/**
 * Let mouse, keys, gamepad and headset drive.
 *
 * `scene` draws for the eyes of a headset, `orbit` is the camera of the page, `socket` has
 * `send(text)`, `bufferedAmount` and events "message" as a WebSocket has, `status` is the element
 * that gets the panel of controls, and `element` the canvas. Returns the parts, by name.
 */
export function startInputs({ scene, orbit, socket, status, element }) {
  const hands = new Hands(socket);
  const mouse = new Mouse({ element, orbit, hands });
  const gamepads = new Gamepads({ orbit, hands });
  const headset = new Headset({ canvas: element, scene, hands });
  hands.devices = [mouse, gamepads];
  const panel = new Panel({ hands, headset });
  status.append(panel.element);

  const watching = { role: element.role, ariaLabel: element.ariaLabel };
  const drive = (isDriving) => {
    hands.isDriving = isDriving;
    panel.show(isDriving);
    Object.assign(element, isDriving ? DRIVING : watching);
  };
  let state = null;
  const receive = {
    role: (message) => drive(message.role === "driver"),
    status(message) {
      mouse.tools = message.tools ?? mouse.tools;
      mouse.declaresStages = message.presses !== undefined;
      headset.lines = lines(message, hands.latency.ms);
      if (message.state === "waiting" && state !== "waiting") hands.open();
      state = message.state ?? state;
    },
    pulse({ side, strength, ms }) {
      headset.pulse(side, strength, ms);
      gamepads.pulse(strength, ms);
    },
  };
  socket.addEventListener("close", () => drive(false));
  socket.addEventListener("message", ({ data }) => {
    if (typeof data !== "string") return;
    const message = JSON.parse(data);
    receive[message.kind]?.(message);
  });
  // Not with the browser's images, which may come slowly where no graphics card draws them.
  setInterval(() => headset.isWorn || hands.tick(), TICK_MS);
  return { hands, headset };
}

/** Which arm is moved, ways into a headset, and the list of controls. */
class Panel {
  #arms;

  constructor({ hands, headset }) {
    const arm = (side) => {
      const name = side === "left" ? "Left arm" : "Right arm";
      const button = build("button", { type: "button" }, name);
      button.addEventListener("click", () => (hands.active = side));
      return button;
    };
    const buttons = SIDES.map(arm);
    const mark = () =>
      SIDES.forEach((side, i) => buttons[i].setAttribute("aria-pressed", side === hands.active));
    hands.onActive = mark;
    mark();
    this.#arms = build("div", { role: "group", "aria-label": "Arm that is moved" }, ...buttons);
    const worn = build("div", { role: "group", "aria-label": "Headset" });
    this.element = build("section", { class: "inputs", "aria-label": "Controls" });
    this.element.append(this.#arms, worn, help());
    this.show(false);
    this.#offer(worn, headset);
  }

  /** Show what only a driver needs, or hide it. */
  show(isDriving) {
    this.#arms.hidden = !isDriving;
  }

  async #offer(place, headset) {
    const { vr, ar, reason } = await support();
    const problem = build("p", { role: "status" }, reason ?? "");
    const offered = { "immersive-vr": vr, "immersive-ar": ar };
    const buttons = Object.keys(WORN)
      .filter((mode) => offered[mode])
      .map((mode) => {
        const button = build("button", { type: "button" }, WORN[mode]);
        button.addEventListener("click", () => {
          problem.textContent = "";
          headset.enter(mode).catch((error) => {
            problem.textContent = `The headset did not start: ${error.message}`;
          });
        });
        return button;
      });
    place.append(...buttons, problem);
    headset.onChange = () => buttons.forEach((button) => (button.disabled = headset.isWorn));
  }
}
