// What the cameras of a rig see: the newest image of each, and how old it is where that matters.

import { make } from "./controls.js";

const SILENT_MS = 2000; // without news for longer, nobody knows how old an image is
const LOOK_MS = 500;
const LOST = "The server says nothing about this camera.";

/** A list of images that are loaded one at a time each, and only when they are seen. */
export class Cameras {
  #place;
  #isCovered;
  #tiles = new Map();
  #heard = 0;

  /** `isCovered` says whether nobody can see the page, as with a headset on. */
  constructor(place, isCovered = () => false) {
    this.#place = place;
    this.#isCovered = isCovered;
    setInterval(() => {
      if (performance.now() - this.#heard > SILENT_MS) this.lost();
    }, LOOK_MS);
  }

  /** Show what the server says of each camera. */
  show(cameras) {
    this.#heard = performance.now();
    const names = cameras.map(({ name }) => name);
    if (names.join() !== [...this.#tiles.keys()].join()) this.#build(cameras);
    const isSeen = !document.hidden && !this.#isCovered();
    for (const camera of cameras) this.#tiles.get(camera.name).show(camera, isSeen);
  }

  /** Nothing is known about the cameras any more. */
  lost() {
    for (const tile of this.#tiles.values()) tile.say(LOST, "");
  }

  #build(cameras) {
    this.#tiles = new Map(cameras.map(({ name, title }) => [name, new Tile(title)]));
    const items = [...this.#tiles.values()].map((tile) => make("li", {}, tile.element));
    this.#place.querySelector("ul").replaceChildren(...items);
    this.#place.hidden = items.length === 0;
  }
}

class Tile {
  #title;
  #image = make("span", { class: "picture" }); // an image, once there is one
  #problem = make("span", { role: "status" });
  #age = make("span", { class: "age" });
  #number = null; // of the image that is shown, or is being loaded
  #isLoading = false;

  constructor(title) {
    this.#title = title;
    const words = make("figcaption", {}, make("b", {}, title), " ", this.#problem, " ", this.#age);
    this.element = make("figure", {}, this.#image, words);
    this.say("No image yet.", "");
  }

  show({ image, number, stale_s: stale }, isSeen) {
    if (number === null) this.say("No image yet.", "");
    else if (stale !== null) this.say("No new image.", `This one is ${stale.toFixed(1)} s old.`);
    else this.say("", "");
    if (isSeen && number !== null && number !== this.#number) this.#load(image, number);
  }

  /** Say what is wrong, and since when; what changes all the time is not read aloud. */
  say(problem, age) {
    if (this.#problem.textContent !== problem) this.#problem.textContent = problem;
    if (this.#age.textContent !== age) this.#age.textContent = age;
    this.element.dataset.state = problem ? "stale" : "live";
  }

  /** Load an image unless one is on its way; the next news asks for what came meanwhile. */
  async #load(address, number) {
    if (this.#isLoading) return;
    this.#isLoading = true;
    this.#number = number;
    const alt = `Live image of the ${this.#title.toLowerCase()}`;
    const next = make("img", { class: "picture", src: `${address}&number=${number}`, alt });
    try {
      await next.decode();
      this.#image.replaceWith(next);
      this.#image = next;
      this.element.dataset.shown = number;
    } catch {
      this.#number = null; // tried again with the next news
    } finally {
      this.#isLoading = false;
    }
  }
}
