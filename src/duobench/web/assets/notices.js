// What has to be seen at once, over the scene: silence of the server, who took over, limits.

import { make } from "./controls.js";

const LOOK_MS = 100; // how often the silence is looked at
const SILENT_MS = 500; // without an answer for longer, what is shown is old
const STALL_MS = 300; // a page that stood still for longer has heard nothing by its own fault
const LIMIT_MS = 300; // an arm that lags for a moment is not kept back

/** Lines over the scene, each of which is there only while it holds. */
export class Notices {
  /** Called when the server does not answer any more, and when it does again. */
  onSilence = () => {};
  #seconds = make("span", { "aria-hidden": "true" });
  #silence = make("p", { class: "bad" });
  #words = make("span", { role: "status" });
  #taken = make("p", { role: "status" });
  #limits = make("p", { role: "status" });
  #heard = null; // when the server was heard last; null while nothing is expected
  #looked = performance.now();
  #limitedSince = {};

  constructor(place) {
    this.#silence.append(this.#words, this.#seconds);
    place.append(make("div", { class: "notices" }, this.#silence, this.#taken, this.#limits));
    setInterval(() => this.#look(performance.now()), LOOK_MS);
    for (const line of [this.#silence, this.#taken, this.#limits]) line.hidden = true;
  }

  /** The server said something; with `false` it is not expected to. */
  heard(isExpected = true) {
    this.#heard = isExpected ? performance.now() : null;
  }

  /** Say that somebody leads in place of this page, or with "" that nobody does. */
  taken(words) {
    write(this.#taken, words);
  }

  /** Say which arms are kept from where their hands want them. */
  limit(limited) {
    const now = performance.now();
    const sides = ["left", "right"].filter((side) => {
      this.#limitedSince[side] = limited[side] ? (this.#limitedSince[side] ?? now) : null;
      return limited[side] && now - this.#limitedSince[side] >= LIMIT_MS;
    });
    const arms = `${sides.join(" and ")} arm${sides.length > 1 ? "s" : ""}`;
    write(this.#limits, sides.length ? `The ${arms} can follow no farther that way.` : "");
  }

  #look(now) {
    const late = now - this.#looked;
    this.#looked = now;
    if (late > STALL_MS && this.#heard !== null) this.#heard = Math.min(now, this.#heard + late);
    const silent = this.#heard === null ? 0 : now - this.#heard;
    const isSilent = silent > SILENT_MS;
    if (isSilent === this.#silence.hidden) this.onSilence(isSilent);
    write(this.#words, isSilent ? "No answer from the server" : "");
    this.#seconds.textContent = isSilent ? ` for ${(silent / 1000).toFixed(1)} s` : "";
    this.#silence.hidden = !isSilent;
  }
}

function write(element, words) {
  if (element.textContent !== words) element.textContent = words;
  if (element.tagName === "P") element.hidden = !words;
}
