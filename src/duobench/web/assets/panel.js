// The panel of a session: numbered steps, what may be pressed now, and the hold of both arms.

import { make } from "./controls.js";

const TEXTS = "input:not([type]), input[type=text], textarea"; // where Space is a letter

/** Fills the panel as its server says; `tell` sends a message. */
export class Panel {
  #steps;
  #buttons;
  #holding;
  #tell;
  #shown = "";

  constructor(page, tell) {
    this.#steps = page.querySelector(".steps");
    this.#buttons = page.querySelector(".buttons");
    this.#holding = page.querySelector(".stop p");
    this.#tell = tell;
  }

  /** Show steps, and to who may press them the buttons. */
  show({ steps, now, buttons, holding }, mayPress) {
    const text = JSON.stringify([steps, now, buttons, mayPress]);
    if (text === this.#shown) return;
    this.#shown = text;
    if (holding) this.#holding.textContent = holding;
    this.#steps.replaceChildren(...steps.map((words, index) => step(words, index, now)));
    this.#steps.hidden = false;
    this.#showButtons(mayPress ? buttons : []);
  }

  /** A button that stays keeps its element, and so the focus. */
  #showButtons(buttons) {
    const old = new Map([...this.#buttons.children].map((one) => [one.firstChild.id, one]));
    const items = buttons.map((one) => {
      const item = old.get(one.id) ?? this.#build(one.id);
      const [button, why] = item.children;
      button.textContent = one.words;
      button.message = one.message;
      button.disabled = one.why_not !== "";
      button.classList.toggle("next", one.is_next);
      why.textContent = one.why_not && `: ${one.why_not}`;
      return item;
    });
    const isSame = items.length === old.size && items.every((item) => old.get(item.firstChild.id));
    if (!isSame || items.some((item, index) => this.#buttons.children[index] !== item)) {
      const focused = document.activeElement;
      this.#buttons.replaceChildren(...items);
      if (this.#buttons.contains(focused)) focused.focus();
    }
  }

  #build(id) {
    const button = make("button", { type: "button", id });
    button.addEventListener("click", () => this.#tell(button.message));
    return make("span", {}, button, make("span", { class: "soft small" }));
  }
}

function step(words, index, now) {
  const state = index < now ? "done" : index === now ? "now" : "later";
  const item = make("li", { "data-state": state }, make("b", {}, String(index + 1)), ` ${words}`);
  if (state === "now") item.setAttribute("aria-current", "step");
  if (state === "done") item.append(make("span", { class: "hidden" }, ", done"));
  return item;
}

/**
 * Let the red button, and Space wherever the focus is but in a field for text, hold both arms.
 *
 * `canHold` says whether arms may move; who watches may hold too.
 */
export function letHold(button, tell, canHold) {
  const hold = () => tell({ kind: "hold" });
  const isHold = (event) => event.key === " " && canHold() && !event.target.matches?.(TEXTS);
  button.addEventListener("click", hold);
  const listen = (type, act) =>
    addEventListener(
      type,
      (event) => {
        if (!isHold(event)) return;
        event.preventDefault();
        event.stopImmediatePropagation();
        act(event);
      },
      true,
    );
  listen("keydown", (event) => event.repeat || hold());
  listen("keyup", () => {});
}
