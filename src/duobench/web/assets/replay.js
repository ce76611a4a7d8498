// Episodes in 3D inside a page that needs nothing else: their scenes and tracks stand in it.

import { Chips, stageAt, Timeline } from "./controls.js";
import { Track } from "./track.js";
import { View } from "./view.js";

const LONGEST_S = 0.25; // a longer pause of the browser does not count as time of the episode

/** The bytes that an element of the page holds as base64. */
function bytesIn(id) {
  const text = atob(document.getElementById(id).textContent.trim());
  return Uint8Array.from(text, (letter) => letter.charCodeAt(0));
}

/** One viewer for all episodes of a section; graphics are first touched when one is opened. */
class Replays {
  #root;
  #episodes;
  #viewer;
  #view = null;
  #scene = null;
  #timeline;
  #chips;
  #episode = null;
  #track = null;
  #step = 0;
  #then = 0;
  #stage = 0;

  constructor(root) {
    this.#root = root;
    this.#episodes = JSON.parse(root.querySelector(".episodes-data").textContent);
    this.#viewer = root.querySelector(".viewer");
    this.#timeline = new Timeline(this.#part(".timeline"));
    this.#timeline.onSeek = (step) => this.#go(step);
    this.#timeline.onPlay = (isPlaying) => (isPlaying ? this.#play() : this.#pause());
    this.#chips = new Chips(this.#part(".chips"), (stage) => {
      this.#pause();
      this.#go(this.#episode.stage_changes.find((change) => change[1] >= stage)[0]);
    });
    this.#part("canvas").addEventListener("keydown", (event) => {
      if (event.key !== " ") return;
      event.preventDefault();
      this.#timeline.onPlay(!this.#timeline.isPlaying);
    });
    document.addEventListener("click", (event) => {
      const button = event.target.closest("[data-replay]");
      if (button && this.#find(button.dataset.replay)) {
        this.open(button.dataset.replay, { plays: true, scrolls: !root.contains(button) });
      }
    });
    document.addEventListener("visibilitychange", () => document.hidden && this.#pause());
    if (root.hasAttribute("data-open")) this.open(this.#episodes[0].id);
  }

  /** Show an episode, and play it where people did not ask for less motion. */
  async open(id, { plays = false, scrolls = false } = {}) {
    const episode = this.#find(id);
    this.#pause();
    this.#episode = episode;
    this.#track = null;
    this.#viewer.hidden = false;
    for (const button of document.querySelectorAll("[data-replay]")) {
      if (this.#find(button.dataset.replay)) {
        button.setAttribute("aria-pressed", String(button.dataset.replay === id));
      }
    }
    this.#part(".title").textContent = episode.title;
    this.#part(".instruction").textContent = episode.instruction;
    if (scrolls) this.#viewer.scrollIntoView({ block: "center" });
    try {
      this.#view ??= new View(this.#part("canvas"));
      const track = await Track.read(bytesIn(episode.track));
      if (this.#scene !== episode.scene) {
        this.#scene = episode.scene;
        await this.#view.load(bytesIn(episode.scene));
      }
      if (this.#episode !== episode) return; // another one was chosen meanwhile
      this.#track = track;
    } catch (error) {
      this.#fail(error);
      return;
    }
    const { rate_hz: rate, stage_changes: changes, stages } = episode;
    this.#timeline.content = { steps: this.#track.steps, rate, changes, last: stages.length };
    this.#stage = 0;
    this.#go(0);
    const isCalm = matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (plays && !isCalm) this.#play();
    this.#root.dataset.shown = id;
  }

  #find(id) {
    return this.#episodes.find((episode) => episode.id === id);
  }

  #part(selector) {
    return this.#viewer.querySelector(selector);
  }

  #fail(error) {
    const problem = this.#part(".problem");
    problem.textContent = error.message;
    problem.hidden = false;
  }

  #go(step) {
    if (!this.#track) return;
    this.#step = Math.max(0, Math.min(this.#track.steps - 1, step));
    this.#view.scene.setPoses(this.#track.at(this.#step));
    this.#timeline.step = this.#step;
    const { stages, stage_changes: changes } = this.#episode;
    const stage = stageAt(changes, this.#step);
    this.#chips.show(stages, stage, stageAt(changes, Infinity));
    if (stage > this.#stage) {
      this.#part(".said").textContent = `Stage ${stage} reached: ${stages[stage - 1] ?? ""}`;
    }
    this.#stage = stage;
  }

  #play() {
    if (!this.#track || this.#timeline.isPlaying) return;
    if (this.#step >= this.#track.steps - 1) this.#go(0);
    this.#timeline.isPlaying = true;
    this.#then = performance.now();
    requestAnimationFrame((now) => this.#advance(now));
  }

  #pause() {
    this.#timeline.isPlaying = false;
  }

  #advance(now) {
    if (!this.#timeline.isPlaying) return;
    const seconds = Math.min(LONGEST_S, Math.max(0, (now - this.#then) / 1000));
    this.#then = now;
    this.#go(this.#step + seconds * this.#episode.rate_hz * this.#timeline.speed);
    if (this.#step >= this.#track.steps - 1) this.#pause();
    else requestAnimationFrame((later) => this.#advance(later));
  }
}

document.querySelectorAll("[data-replays]").forEach((root) => new Replays(root));
