// Everything with which a person drives the arms, and the panel that says how.

import { make } from "./controls.js";
import { Gamepads } from "./gamepad.js";
import { Hands } from "./hands.js";
import { Headset, support } from "./headset.js";
import { Mouse } from "./mouse.js";
import { Words } from "./words.js";

const SIMULATION = "simulation"; // kinds of pages
const DEMONSTRATIONS = "demonstrations"; // of real arms, whose stages a person says
const VIEWS = "look from behind, in front, the head, above, the side, behind the tool";
/**
 * What keys do while the scene is in focus: `keys` gives each its value for the act of `mouse.js`,
 * `shown` and `does` are the line of the list, `on` is the kind of page if not both have it.
 */
const KEYS = [
  {
    act: "lead",
    keys: { 1: "left", 2: "right", 3: "both" },
    shown: "1, 2, 3",
    does: "left arm, right arm, both",
    on: SIMULATION,
  },
  { act: "next", keys: { Tab: "" }, shown: "Tab", does: "left arm, both, right arm, one by one" },
  {
    act: "mirror",
    keys: { m: "" },
    shown: "M",
    does: "both arms: mirrored, or as if they held one thing",
  },
  {
    act: "steer",
    keys: {
      ArrowRight: ["right", 1],
      ArrowLeft: ["right", -1],
      ArrowUp: ["away", 1],
      ArrowDown: ["away", -1],
      PageUp: ["up", 1],
      PageDown: ["up", -1],
    },
    shown: "Arrow keys, Page Up, Page Down",
    does: "move the tool along the table, up and down; with Shift turn it",
  },
  {
    act: "steer",
    keys: { q: ["upright", 1], e: ["upright", -1] },
    shown: "Q, E",
    does: "turn it about the vertical",
  },
  { shown: "Space", does: "hold: both hands let go, both arms stand still" },
  {
    shown: "1 to 9, U",
    does: "this stage is reached; take the latest one back",
    on: DEMONSTRATIONS,
  },
  { act: "fine", keys: { c: "" }, shown: "C, held", does: "a quarter of every motion" },
  {
    act: "grip",
    keys: { g: "left", j: "right" },
    shown: "G, J",
    does: "left, right gripper: tap to close or open, hold for as long as you hold",
  },
  { shown: "C and G or J; Shift and G or J", does: "close, open it by a quarter" },
  // Far from all that drives.
  { act: "say", keys: { Enter: "keep" }, shown: "Enter", does: "keep the episode" },
  {
    act: "say",
    keys: { Backspace: "discard", p: "restore" },
    shown: "Backspace, P",
    does: "discard it; ask about the last discarded one again",
  },
  {
    act: "say",
    keys: { r: "alone" },
    shown: "R",
    does: "let the world run though you do not lead, or no longer; pause a policy",
  },
  {
    act: "say",
    keys: { n: "why" },
    shown: "N",
    does: "say why you took over from a policy; again for another reason",
  },
  { shown: "5, 6, 7, 8, 9, 0", does: VIEWS, on: SIMULATION },
  { shown: "Shift and 5, 6, 7, 8, 9, 0", does: VIEWS, on: DEMONSTRATIONS },
  { shown: "+, -; F", does: "camera nearer, farther; full screen" },
  {
    act: "leave",
    keys: { Escape: "" },
    shown: "Escape, or Shift and Tab",
    does: "leave the scene, to reach the rest of the page",
  },
];
const CONTROLS = {
  "Mouse, with the pointer on the scene": [
    ["Drag", "move the tool as you see it"],
    ["Ctrl and drag, or the wheel", "move it away and back"],
    ["Shift and drag, Shift and wheel", "turn it"],
    ["Drag with the right button, or Ctrl and wheel", "move the camera"],
  ],
  Gamepad: [
    ["Left stick", "move the tool along the table"],
    ["Right stick", "up and down; sideways: turn it"],
    ["A and the sticks", "turn it about all axes"],
    ["Bumpers", "left arm, right arm; both at once: both arms"],
    ["Both arms", "each stick its tool; with A up, down and about the vertical"],
    ["Both arms and B", "as one thing, by both sticks as one arm"],
    ["Triggers", "left, right gripper"],
    ["Start, Back", "keep or discard the episode"],
    ["Y", "ask about the last discarded one again"],
  ],
  Headset: [
    ["Grip", "hold it to move the tool with your hand; let go to reach further"],
    ["Index trigger", "close the gripper, as far as you press"],
    ["A or X", "keep the episode"],
    ["B, Y", "discard it; ask about the last discarded one again"],
    ["Click a stick", "put the view, or the table, anew"],
    ["Click both sticks", "hold the arms"],
    ["Trigger for 1 s", "drive, or take over, while you do not drive"],
  ],
  "Bare hands in a headset": [
    ["Close middle, ring and little finger", "as a grip: move the tool with your hand"],
    ["Thumb and index finger", "the gripper, as far as they are apart"],
    ["Pinch for 1 s at the end", "keep it with the right hand, discard it with the left one"],
  ],
};
const DRIVING = {
  role: "application",
  ariaLabel: "The table and the robot in 3D. Keys move the arms; Controls lists them.",
};
const TICK_MS = 8; // how often it is asked whether a message is due
const ARMS = { left: "Left arm", right: "Right arm", both: "Both arms" };
const WORN = { "immersive-vr": "Enter VR", "immersive-ar": "Enter AR" };

/** The keys of a kind of page. */
function keysOf(kind) {
  return KEYS.filter(({ on = kind }) => on === kind);
}

/** The acts of these keys by key, as `mouse.js` takes them. */
function actsOf(rows) {
  return new Map(
    rows.flatMap(({ act, keys = {} }) =>
      Object.entries(keys).map(([key, value]) => [key, [act, value]]),
    ),
  );
}

/** What is known in this browser of the one before it; null where it keeps nothing. */
function kept(name, value) {
  try {
    if (value !== undefined) localStorage.setItem(name, value);
    return localStorage.getItem(name);
  } catch {
    return null;
  }
}

/** The list of controls, open until somebody folds it. */
class Help {
  element = make("details", { class: "help" });

  constructor() {
    this.element.open = kept("duobench-controls") !== "folded";
    this.element.addEventListener("toggle", () =>
      kept("duobench-controls", this.element.open ? "open" : "folded"),
    );
  }

  /** List what these rows of keys do, among the rest. */
  show(rows) {
    const [mouse, ...others] = Object.entries(CONTROLS);
    const keys = rows.map(({ shown, does }) => [shown, does]);
    const parts = [mouse, ["Keys, while the scene is in focus", keys], ...others];
    const sections = parts.map(([device, lines]) => {
      const list = make("dl");
      for (const [what, does] of lines) list.append(make("dt", {}, what), make("dd", {}, does));
      return make("section", {}, make("h2", {}, device), list);
    });
    this.element.replaceChildren(make("summary", {}, "Controls"), ...sections);
  }
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
  const words = new Words();
  headset.words = (more) => words.onBoard({ ...more, ms: hands.latency.ms });
  headset.onAsk = (what) => {
    if (what === "drive") hands.tell(words.isTaken ? "take_over" : "drive");
    else hands.say(what);
  };

  let kind = null;
  const adapt = (found) => {
    if (found === kind) return;
    kind = found;
    const rows = keysOf(kind);
    mouse.keys = actsOf(rows);
    panel.help.show(rows);
  };
  adapt(SIMULATION);

  const watching = { role: element.role, ariaLabel: element.ariaLabel };
  const drive = (isDriving) => {
    hands.isDriving = isDriving;
    panel.show(isDriving);
    Object.assign(element, isDriving ? DRIVING : watching);
    panel.say(words.onPage());
  };
  let state = null;
  const receive = {
    role(message) {
      words.role = message;
      drive(message.role === "driver");
    },
    status(message) {
      words.status = message;
      hands.tools = message.tools ?? hands.tools;
      headset.state = message.state;
      adapt(message.says_stages ? DEMONSTRATIONS : SIMULATION);
      if (message.state === "waiting" && state !== "waiting") hands.open();
      state = message.state ?? state;
      panel.say(words.onPage());
    },
    pulse({ side, strength, ms }) {
      headset.pulse(side, strength, ms);
      gamepads.pulse(strength, ms);
    },
  };
  socket.addEventListener("close", () => {
    words.cut();
    drive(false);
  });
  socket.addEventListener("message", ({ data }) => {
    if (typeof data !== "string") return;
    const message = JSON.parse(data);
    receive[message.kind]?.(message);
  });
  // Not with the browser's images, which may come slowly where no graphics card draws them.
  setInterval(() => headset.isWorn || hands.tick(), TICK_MS);
  return { hands, headset };
}

/** What is to be done, which arm is moved, ways into a headset, and the list of controls. */
class Panel {
  help = new Help();
  #arms;
  #said = make("p", { role: "status" });

  constructor({ hands, headset }) {
    const button = (name, act) => {
      const made = make("button", { type: "button" }, name);
      made.addEventListener("click", act);
      return made;
    };
    const arms = Object.entries(ARMS).map(([side, name]) => [
      side,
      button(name, () => (hands.active = side)),
    ]);
    for (const [side, each] of arms) each.dataset.side = side; // in the colour of its marks
    const mirrored = button("Mirrored", () => (hands.isMirrored = !hands.isMirrored));
    const mark = () => {
      for (const [side, each] of arms) each.setAttribute("aria-pressed", side === hands.active);
      mirrored.setAttribute("aria-pressed", hands.isMirrored);
      mirrored.hidden = hands.active !== "both";
    };
    hands.onActive = mark;
    mark();
    const buttons = [...arms.map(([, each]) => each), mirrored];
    this.#arms = make("div", { role: "group", "aria-label": "Arm that is moved" }, ...buttons);
    const worn = make("div", { role: "group", "aria-label": "Headset" });
    this.element = make("section", { class: "inputs", "aria-label": "Controls" });
    this.element.append(this.#said, this.#arms, worn, this.help.element);
    this.show(false);
    this.say("");
    this.#offer(worn, headset);
  }

  /** Show what only a driver needs, or hide it. */
  show(isDriving) {
    this.#arms.hidden = !isDriving;
  }

  /** Say what is to be done, or nothing. */
  say(text) {
    if (this.#said.textContent !== text) this.#said.textContent = text;
    this.#said.hidden = !text;
  }

  async #offer(place, headset) {
    const { vr, ar, reason } = await support();
    const problem = make("p", { role: "status" }, reason ?? "");
    const offered = { "immersive-vr": vr, "immersive-ar": ar };
    const buttons = Object.keys(WORN)
      .filter((mode) => offered[mode])
      .map((mode) => {
        const button = make("button", { type: "button" }, WORN[mode]);
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
