// What the server says, in words: episode, stages, who drives, what can be chosen.

import { Chips, make, Timeline } from "./controls.js";
import { letHold, Panel } from "./panel.js";

const STATES = { playing: "Playing", paused: "Paused" }; // where no panel says it

const JUDGED = ["recording", "success", "paused", "decide"]; // where stages are declared

/** Fills the page; `tell` sends a message to the server. */
export class Status {
  /** Gives the ms from a hand to the picture that shows it; null where nothing was measured. */
  latency = () => null;
  #page;
  #tell;
  #panel;
  #judging = null; // what takes stages, once it was loaded
  #chips;
  #timeline;
  #last = {};
  #items = "";
  #isDrivable = false;
  #isDriver = false;
  #role = null;

  constructor(page, tell) {
    this.#page = page;
    this.#tell = tell;
    this.#chips = new Chips(this.#part(".chips"));
    this.#timeline = new Timeline(this.#part(".timeline"), { hasSpeed: false });
    this.#timeline.onSeek = (step) => tell({ kind: "seek", step });
    this.#timeline.onPlay = (on) => tell({ kind: "play", on });
    this.#panel = new Panel(page, tell);
    letHold(this.#part("#hold"), tell, () => this.#last.panel?.can_hold);
    this.#part("#drive").addEventListener("click", () => {
      const isTaken = this.#role?.drivers > 0;
      tell({ kind: isTaken ? "take_over" : "drive" });
    });
    this.#part("#wording").addEventListener("submit", (event) => {
      event.preventDefault();
      tell({ kind: "instruction", text: this.#part("#wording input").value.trim() });
    });
  }

  connected(isConnected) {
    if (!isConnected) this.showRole({ role: "viewer", drivers: 0, viewers: 1 });
    this.#write(".link", isConnected ? "Connected" : "Connection lost. Trying again …");
    this.#part(".link").dataset.state = isConnected ? "good" : "bad";
  }

  show(status) {
    this.#last = status;
    const { title, task, instruction, next, state, note, success, panel } = status;
    const name = title ?? task;
    if (name) document.title = `${name} · DuoBench`;
    this.#write("h1", name ?? "DuoBench");
    this.#write(".instruction", instruction);
    this.#write(".next", next && `Next: ${next}`);
    this.#write(".state", panel?.title ?? STATES[state] ?? state);
    this.#part(".state").dataset.state = success ? "success" : (state ?? "");
    this.#write(".note", panel?.todo ?? note);
    this.#part("#holding").hidden = !panel;
    this.#showStages(status);
    this.#showFacts(status);
    this.#showItems(status.items ?? [], status.selected);
    this.#showTimeline(status);
    this.#showDriving();
  }

  showRole(role) {
    this.#role = role;
    this.#isDriver = role.role === "driver";
    this.#showDriving();
  }

  showPing(milliseconds) {
    this.#write(".ping", `${Math.round(milliseconds)} ms to the server`);
  }

  showStep(step) {
    if (this.#last.steps) this.#timeline.step = step;
  }

  /** Say something that passes. */
  say(text) {
    this.#write(".note", text);
  }

  /** Say what went wrong. */
  fail(text) {
    this.#write(".problem", text);
  }

  /** What drives is there. */
  canBeDriven() {
    this.#isDrivable = true;
    this.#part("#driving").hidden = false;
    this.#showDriving();
  }

  #showStages({ stages, stage = 0, max_stage: last, stage_changes: changes = [] }) {
    const words = stages ?? Array.from({ length: last ?? 0 }, () => "");
    const ever = changes.reduce((most, [, reached]) => Math.max(most, reached), stage);
    this.#chips.show(words, stage, ever);
  }

  #showFacts({ count, kept, wanted, discarded, latency_ms: served, lost, clutch }) {
    const seen = this.latency();
    const said = (ms) => (ms === null || ms === undefined ? null : `${Math.round(ms)} ms`);
    const held = clutch && ["left", "right"].filter((side) => clutch[side]);
    const facts = {
      Episode: count,
      Kept: kept === undefined ? undefined : wanted ? `${kept} of ${wanted}` : kept,
      Discarded: discarded || null,
      "Hand to picture": said(seen),
      "Of it on the server": seen === null ? null : said(served),
      "Samples lost": lost,
      Clutch: held && (held.length ? `${held.join(" and ")} closed` : "open"),
    };
    const rows = Object.entries(facts)
      .filter(([, value]) => value !== undefined && value !== null)
      .map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, `${value}`)));
    this.#part(".facts").replaceChildren(...rows);
  }

  /** A list of what can be shown. */
  #showItems(items, selected) {
    const text = JSON.stringify([items, selected]);
    if (text === this.#items) return;
    this.#items = text;
    const list = this.#part(".items");
    const focused = list.contains(document.activeElement) && document.activeElement.dataset.item;
    const buttons = items.map(({ id, title, detail, state }) => {
      const button = make("button", { type: "button", "data-item": id }, make("b", {}, title));
      if (detail) button.append(make("span", {}, detail));
      if (state) button.dataset.state = state;
      button.setAttribute("aria-pressed", String(id === selected));
      button.addEventListener("click", () => this.#tell({ kind: "select", id }));
      return button;
    });
    list.replaceChildren(...buttons.map((button) => make("li", {}, button)));
    this.#part("#choice").hidden = items.length === 0;
    buttons.find((button) => button.dataset.item === String(focused))?.focus();
  }

  #showTimeline({ steps, step, rate_hz: rate = 30, state, stage_changes: changes = [], ...rest }) {
    this.#part(".timeline").hidden = !steps;
    if (!steps) return;
    const last = rest.max_stage ?? rest.stages?.length ?? 0;
    this.#timeline.content = { steps: steps + 1, rate, changes, last };
    this.#timeline.isPlaying = state === "playing";
    if (step !== undefined) this.#timeline.step = step;
  }

  #showDriving() {
    const { role = "viewer", drivers = 0, viewers = 1 } = this.#role ?? {};
    const watching = viewers - (this.#isDriver ? 0 : 1);
    const driving = role === "driver" ? "You drive" : drivers ? "Somebody drives" : "Nobody drives";
    const words = [
      this.#isDrivable && driving,
      watching > 0 && `${watching} other${watching > 1 ? "s" : ""} watching`,
    ];
    this.#write(".role", words.filter(Boolean).join(" · "));
    this.#part("#hint").hidden = this.#isDriver;
    const drive = this.#part("#drive");
    const isTaken = !this.#isDriver && this.#role?.drivers > 0;
    drive.hidden = this.#isDriver;
    drive.textContent = isTaken ? "Take over" : "Drive";
    const { instruction, panel } = this.#last;
    if (panel) this.#panel.show(panel, this.#isDriver);
    this.#showJudging();
    const wording = this.#part("#wording");
    wording.hidden = !this.#isDriver;
    const input = wording.querySelector("input");
    if (document.activeElement !== input) input.value = instruction ?? "";
  }

  /** Stages that a person declares; what takes them is loaded only where one does. */
  async #showJudging() {
    if (!this.#last.presses) return;
    if (!this.#judging) {
      this.#judging = import("./judging.js");
      const { Judging } = await this.#judging;
      this.#judging = new Judging(this.#page, { undo: "u" });
      this.#judging.onStage = (stage) => this.#tell({ kind: "stage", stage });
      this.#judging.onUndo = () => this.#tell({ kind: "undo" });
    }
    if (!this.#judging.show) return; // it still loads
    this.#judging.isOpen = this.#isDriver && JUDGED.includes(this.#last.state);
    this.#part("#judging").hidden = !this.#judging.isOpen;
    this.#judging.show(this.#last);
  }

  #part(selector) {
    return this.#page.querySelector(selector);
  }

  #write(selector, text) {
    const part = this.#part(selector);
    const words = text ?? "";
    if (part.textContent !== words) part.textContent = words;
    part.hidden = words === "";
  }
}
