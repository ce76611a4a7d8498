// What the server says, in words: episode, stages, who drives, what can be chosen.

import { Chips, make, Timeline } from "./controls.js";
import { letHold, Panel } from "./panel.js";

const STATES = { playing: "Playing", paused: "Paused" }; // where no panel says it

const JUDGED = ["recording", "success", "paused", "decide"]; // where stages are declared
const WORLD = {
  led: "runs as you lead",
  resting: "runs until all is at rest",
  alone: "runs alone",
  standing: "stands still",
};
const RUNNING = ["recording", "success"]; // where it can

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
  #hasDriven = false; // and was not replaced since
  #role = null;
  #name = null; // pseudonym under which this page drives, or is to

  constructor(page, tell) {
    this.#page = page;
    this.#tell = tell;
    this.#chips = new Chips(this.#part(".chips"));
    this.#timeline = new Timeline(this.#part(".timeline"), { hasSpeed: false });
    this.#timeline.onSeek = (step) => tell({ kind: "seek", step });
    this.#timeline.onPlay = (on) => tell({ kind: "play", on });
    this.#panel = new Panel(page, tell);
    letHold(this.#part("#hold"), tell, () => this.#last.panel?.can_hold);
    for (const kind of ["alone", "why"]) {
      this.#part(`#${kind}`).addEventListener("click", () => tell({ kind }));
    }
    this.#part("#drive").addEventListener("click", () => {
      const isTaken = this.#role?.drivers > 0;
      tell({ kind: isTaken ? "take_over" : "drive" });
    });
    this.#part("#wording").addEventListener("submit", (event) => {
      event.preventDefault();
      tell({ kind: "instruction", text: this.#part("#wording input").value.trim() });
    });
    this.#part("#who").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#name = this.#part("#who input").value.trim();
      if (this.#isDriver) tell({ kind: "operator", name: this.#name });
    });
  }

  connected(isConnected) {
    if (!isConnected) this.showRole({ role: "viewer", drivers: 0, viewers: 1 });
    this.#write(".link", isConnected ? "Connected" : "Connection lost. Trying again …");
    this.#part(".link").dataset.state = isConnected ? "good" : "bad";
  }

  show(status) {
    this.#last = status;
    if (this.#isDriver) this.#name = status.operator ?? null;
    const { title, task, instruction, next, state, note, success, pace, panel } = status;
    const stands = state === "recording" && pace === "standing";
    const name = title ?? task;
    if (name) document.title = `${name} · DuoBench`;
    this.#write("h1", name ?? "DuoBench");
    this.#write(".instruction", instruction);
    this.#write(".next", next && `Next: ${next}`);
    const words = panel?.title ?? STATES[state] ?? state;
    this.#write(".state", stands ? "Standing still: lead on" : words);
    this.#part(".state").dataset.state = success ? "success" : stands ? "" : (state ?? "");
    this.#write(".note", panel?.todo ?? note);
    this.#part("#holding").hidden = !panel;
    const { led_s: led, limit_s: limit } = status;
    this.#write(".led", led === undefined ? "" : `${Math.floor(led)} of ${limit} s led`);
    this.#showStages(status);
    this.#showFacts(status);
    this.#showTimeline(status);
    this.#showDriving();
  }

  showRole(role) {
    const wasDriver = this.#isDriver;
    this.#role = role;
    this.#isDriver = role.role === "driver";
    this.#hasDriven ||= this.#isDriver;
    if (this.#isDriver && !wasDriver && this.#name !== null) {
      this.#tell({ kind: "operator", name: this.#name });
    }
    if (this.#isDriver) this.#name ??= this.#last.operator ?? null;
    this.#showDriving();
  }

  /** Whether this page drives. */
  get isDriver() {
    return this.#isDriver;
  }

  /** Who drives in place of this page, in words; empty while nobody does. */
  get taken() {
    const isTaken = this.#hasDriven && !this.#isDriver && this.#role?.drivers > 0;
    return isTaken ? `${this.#other} took over.` : "";
  }

  /** Show how long the server took to answer; null while it does not. */
  showPing(milliseconds) {
    const time = milliseconds === null ? "–" : Math.round(milliseconds);
    this.#write(".ping", `${time} ms to the server`);
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

  #showFacts(status) {
    const { count, kept, wanted, discarded, latency_ms: served, lost, clutch } = status;
    const { state, pace, policy } = status;
    const seen = this.latency();
    const said = (ms) => (ms === null || ms === undefined ? null : `${Math.round(ms)} ms`);
    const held = clutch && ["left", "right"].filter((side) => clutch[side]);
    const facts = {
      Episode: count,
      Leads: policy ? (policy.leads ? policy.name : "you") : undefined,
      World: !RUNNING.includes(state) || policy?.leads ? undefined : WORLD[pace],
      Kept: kept === undefined ? undefined : wanted ? `${kept} of ${wanted}` : kept,
      Discarded: discarded || null,
      "Hand to picture": said(seen),
      "Of it on the server": seen === null ? null : said(served),
      "Moments of your hands too late to count": lost,
      Clutch: held && (held.length ? `${held.join(" and ")} closed` : "open"),
    };
    const rows = Object.entries(facts)
      .filter(([, value]) => value !== undefined && value !== null)
      .map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, `${value}`)));
    this.#part(".facts").replaceChildren(...rows);
  }

  /** Offer what can be shown, in a list. */
  offer(items, selected) {
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
    const spans = rest.corrections ?? [];
    this.#timeline.content = { steps: steps + 1, rate, changes, last, spans };
    this.#timeline.isPlaying = state === "playing";
    if (step !== undefined) this.#timeline.step = step;
  }

  #showDriving() {
    const { role = "viewer", drivers = 0, viewers = 1 } = this.#role ?? {};
    const watching = viewers - (this.#isDriver ? 0 : 1);
    const { state, wording = "", operator, operators = [], panel } = this.#last;
    const you = operator ? `You drive as ${operator}` : "You drive";
    const other = drivers ? `${this.#other} drives` : "Nobody drives";
    const driving = role === "driver" ? you : other;
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
    if (panel) this.#panel.show(panel, this.#isDriver);
    this.#showJudging();
    const alone = this.#part("#alone");
    alone.hidden = !this.#isDriver || !this.#last.pace || !RUNNING.includes(state);
    const { policy } = this.#last;
    alone.textContent = policy ? "Pause the policy" : "Run alone";
    const isOn = policy ? policy.is_paused : this.#last.alone;
    alone.setAttribute("aria-pressed", String(Boolean(isOn)));
    this.#part("#why").hidden = alone.hidden || !policy?.is_explainable;
    this.#part("#wording").hidden = !this.#isDriver;
    this.#fill("#wording input", wording);
    this.#part("#who").hidden = operator === undefined;
    this.#fill("#who input", (this.#isDriver ? operator : this.#name) ?? operator ?? "");
    const known = operators.map((name) => make("option", { value: name }));
    if (this.#part("#operators").childElementCount !== known.length) {
      this.#part("#operators").replaceChildren(...known);
    }
  }

  /** Show what is set, unless somebody is typing. */
  #fill(selector, text) {
    const input = this.#part(selector);
    if (document.activeElement !== input) input.value = text;
  }

  /** The name of somebody else who drives, where the server says it. */
  get #other() {
    return this.#last.operator || "Another page";
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
