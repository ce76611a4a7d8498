// Keys and buttons for stages, with undo, as an operator uses them.

import { make } from "./controls.js";

/** Fills the section of judging; `onStage` and `onUndo` are called with what a person presses. */
export class Judging {
  onStage = () => {};
  onUndo = () => {};
  isOpen = false;
  #page;
  #undo;
  #words = "";
  #buttons = [];

  /** `undo` is the key that takes the latest press back. */
  constructor(page, { undo = "Backspace" } = {}) {
    this.#page = page;
    this.#undo = undo;
    page.querySelector("#undo").addEventListener("click", () => this.isOpen && this.onUndo());
    page.addEventListener("keydown", (event) => this.#press(event));
  }

  /** Show the stages, the highest one that stands, and every press. */
  show({ stages, stage, presses }) {
    const words = JSON.stringify(stages);
    if (words !== this.#words) this.#build(stages, words);
    this.#buttons.forEach((button, index) => {
      button.setAttribute("aria-pressed", String(index < stage));
      button.disabled = !this.isOpen;
    });
    this.#page.querySelector("#undo").disabled = !this.isOpen || presses.length === 0;
    this.#showPresses(presses);
  }

  #build(stages, words) {
    this.#words = words;
    this.#buttons = stages.map((word, index) => {
      const key = index < 9 ? [make("kbd", {}, String(index + 1))] : [];
      const button = make("button", { type: "button", "data-stage": index + 1 }, ...key, word);
      button.addEventListener("click", () => this.isOpen && this.onStage(index + 1));
      return button;
    });
    const items = this.#buttons.map((button) => make("li", {}, button));
    this.#page.querySelector(".stage-keys").replaceChildren(...items);
  }

  #showPresses(presses) {
    const rows = [];
    for (const { stage, step, time_s: time, late } of presses) {
      const when = `${time.toFixed(1)} s, step ${step}${late ? ", long after the end" : ""}`;
      if (stage === null) {
        rows.findLast((row) => row.dataset.stands)?.classList.add("gone");
        const gone = rows.findLast((row) => row.dataset.stands);
        if (gone) delete gone.dataset.stands;
        rows.push(make("li", {}, `${when}: taken back`));
      } else rows.push(make("li", { "data-stands": "yes" }, `${when}: stage ${stage}`));
    }
    this.#page.querySelector(".presses").replaceChildren(...rows);
  }

  #press(event) {
    const isTyping = event.target.matches("input[type=text]");
    if (!this.isOpen || isTyping || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.repeat) return;
    const stage = /^[1-9]$/.test(event.key) ? Number(event.key) : 0;
    if (stage >= 1 && stage <= this.#buttons.length) this.onStage(stage);
    else if (event.key === this.#undo) this.onUndo();
    else return;
    event.preventDefault();
  }
}
