// Views of the table to choose, by keys and by buttons, and the full screen.

import { make } from "./controls.js";

// Metres and degrees; front and back are the robot's, and so are left and right.
const FIXED = {
  front: { eye: [2.0, 0, 0.95], target: [0.45, 0, 0.1], fovy: 37 },
  top: { eye: [0.449, 0, 1.75], target: [0.45, 0, 0], fovy: 40 },
};
const SIDEWAYS = { reach: 0.95, high: 0.12, fovy: 37 };
const BEHIND = { back: 0.5, high: 0.3, fovy: 45 };
const VIEWS = [
  ["5", "behind", "Behind"],
  ["6", "front", "Front"],
  ["7", "head", "Head"],
  ["8", "top", "Top"],
  ["9", "side", "Side"],
  ["0", "hand", "Hand"],
];
const FULL = "f";

/** Lets people choose where they look from. */
export class Views {
  #orbit;
  #page;
  #active;
  #tool;
  #takesDigits;
  #followed = null; // where the tool was that the camera goes with
  /** The robot's cameras, as the scene's file has them. */
  cameras = [];

  /**
   * `active()` gives the arm that is led, `tool(side)` where its tool is, `takesDigits()` whether
   * a digit alone chooses a view; else it takes Shift as well.
   */
  constructor({ bar, page, orbit, active, tool, takesDigits }) {
    this.#takesDigits = takesDigits;
    this.#orbit = orbit;
    this.#page = page;
    this.#active = active;
    this.#tool = tool;
    const button = (key, words, act) => {
      const made = make("button", { type: "button", "aria-keyshortcuts": key }, words);
      made.append(make("kbd", { "aria-hidden": "true" }, key));
      made.addEventListener("click", act);
      return made;
    };
    bar.replaceChildren(
      ...VIEWS.map(([key, view, words]) => button(key, words, () => this.look(view))),
      button("F", "Full screen", () => this.fill()),
    );
    bar.hidden = false;
    addEventListener("keydown", (event) => this.#press(event), { capture: true });
  }

  /**
   * Look from "behind" the robot as at first, "front", "head", "top", "side", or from behind the
   * "hand" that leads, with which the camera goes.
   */
  look(view) {
    this.#followed = view === "hand" ? this.#tool(this.#active()) : null;
    if (view === "behind") return this.#orbit.reset();
    const [x, y, z] = this.#tool(this.#active()) ?? [0.45, 0, 0.15];
    const side = this.#active() === "left" ? 1 : -1;
    const { reach, high, fovy } = SIDEWAYS;
    const seen = {
      head: () => this.#head(),
      side: () => ({ eye: [x, y + side * reach, z * 0.7 + high], target: [x, y, z * 0.7], fovy }),
      hand: () => ({
        eye: [x - BEHIND.back, y + side * 0.12, z + BEHIND.high],
        target: [x, y, z * 0.6],
        fovy: BEHIND.fovy,
      }),
    };
    const from = seen[view]?.() ?? FIXED[view];
    if (from) this.#orbit.aim(from);
  }

  /** Another arm may lead now. */
  lead() {
    if (this.#followed) this.look("hand");
  }

  /** The tools may be elsewhere. */
  follow() {
    const place = this.#followed && this.#tool(this.#active());
    if (!place) return;
    this.#orbit.move(place.map((value, axis) => value - this.#followed[axis]));
    this.#followed = place;
  }

  /** Fill the screen, or no longer. */
  fill() {
    if (document.fullscreenElement) document.exitFullscreen();
    else this.#page.requestFullscreen?.().catch(() => {}); // a browser may not allow it
  }

  /** What the robot's head sees, upright. */
  #head() {
    const head = this.cameras.find(({ name }) => name === "head");
    if (!head) return { eye: [0.0113, 0.001, 0.695], target: [0.81, 0.001, 0], fovy: 52 };
    const [x, y, z, w, i, j, k] = head.pose;
    const forward = [-2 * (i * k + w * j), -2 * (j * k - w * i), 2 * (i * i + j * j) - 1];
    const target = [x, y, z].map((value, axis) => value - (forward[axis] * z) / forward[2]);
    return { eye: [x, y, z], target, fovy: head.fovy };
  }

  #press(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || event.repeat) return;
    if (event.target.matches?.("input, select, textarea")) return;
    const digit = /^(?:Digit|Numpad)(\d)$/.exec(event.code)?.[1] ?? event.key;
    const view = VIEWS.find(([key]) => key === digit);
    if (view && (event.shiftKey || this.#takesDigits())) this.look(view[1]);
    else if (event.key.toLowerCase() === FULL && !event.shiftKey) this.fill();
    else return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }
}
