// The operator's page: place the objects, start a policy, judge what it did.

import { Connection } from "./connection.js";
import { make } from "./controls.js";
import { Judging } from "./judging.js";
import { Overlay } from "./overlay.js";
import { letHold, Panel } from "./panel.js";

const ALIVE_MS = 500; // the arms are held where this page is silent for longer
const REASONS = [
  "The objects were placed wrongly.",
  "A person came into the way.",
  "An object broke or was missing.",
  "The light changed.",
];
/** The page. */
class Trials {
  #connection = Connection.home();
  #overlay = new Overlay(document);
  #judging = new Judging(document);
  #panel = new Panel(document, (message) => this.#connection.tell(message));
  #status = null;
  #trial = "";
  #isDriver = false;
  #table = "";
  #film = "";

  constructor() {
    const connection = this.#connection;
    connection.addEventListener("open", () => {
      this.#link(true);
      this.#tell("drive");
    });
    connection.addEventListener("close", () => {
      this.#isDriver = false;
      this.#link(false);
      this.#allow();
    });
    connection.addEventListener("message", ({ data }) => {
      if (typeof data === "string") this.#receive(JSON.parse(data));
      else this.#overlay.draw(data);
    });
    setInterval(() => this.#isDriver && this.#tell("alive"), ALIVE_MS);
    this.#judging.onStage = (stage) => this.#tell("stage", { stage, ...this.#moment });
    this.#judging.onUndo = () => this.#tell("undo");
    part("#closing").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#tellNote();
      this.#tell("finish");
    });
    part("#note").addEventListener("change", () => this.#tellNote());
    part("#note").addEventListener("keydown", (event) => {
      if (event.key !== "Enter") return;
      event.preventDefault(); // it closes no trial
      this.#tellNote();
    });
    part("#spoiled").addEventListener("submit", (event) => {
      event.preventDefault();
      const reason = part("#reason").value.trim();
      if (reason) this.#tell("invalid", { reason });
      else this.#say("Say why the trial is invalid.");
    });
    for (const choice of document.querySelectorAll("[name=holds]")) {
      choice.addEventListener("change", () => this.#tell("at_end", { holds: choice.value === "yes" }));
    }
    const tell = (message) => connection.tell(message);
    letHold(part("#hold"), tell, () => this.#status?.panel.can_hold);
    part(".role").addEventListener("click", (event) => {
      if (event.target.matches("button")) this.#tell("take_over");
    });
  }

  #tell(kind, fields = {}) {
    this.#connection.tell({ kind, ...fields });
  }

  #tellNote() {
    const text = part("#note").value.trim().replace(/\s+/g, " ");
    if (text !== (this.#status?.note ?? "")) this.#tell("note", { text });
  }

  #receive(message) {
    if (message.kind === "status") this.#show(message);
    else if (message.kind === "role") this.#showRole(message);
    else if (message.kind === "refused") this.#say(message.reason);
  }

  #show(status) {
    const known = this.#status?.note;
    this.#status = status;
    const { phase, trial, blind } = status;
    document.title = `${status.title} · Trials · DuoBench`;
    write("h1", status.title);
    const again = trial.attempt > 1 ? `, attempt ${trial.attempt}` : "";
    const policy = blind ? "policy hidden" : trial.policy;
    const where =
      `Trial ${trial.number} of ${trial.of}${again} · ${policy} · episode ` +
      `${trial.episode} · ${trial.invalid} invalid so far`;
    write(".where", phase === "over" ? "" : where);
    write(".state", status.panel.title);
    write(".todo", status.panel.todo);
    write(".instruction", `“${trial.instruction}”`);
    write(".note", status.message);
    write(".problem", status.fault && `Fault: ${status.fault}`);
    write(".clock", `${status.time_s.toFixed(1)} s · step ${status.step} of ${status.horizon}`);
    this.#showReasons(status.reasons.length ? status.reasons : REASONS);
    if (status.at_end !== null) {
      part(`[name=holds][value=${status.at_end ? "yes" : "no"}]`).checked = true;
    }
    this.#showVariants(trial.variants);
    const isPlacing = ["placing", "ready"].includes(phase);
    this.#overlay.show({ ...status, isPlacing });
    this.#showFootprints(status.footprints);
    const name = `${trial.number}.${trial.attempt}`;
    if (name !== this.#trial) this.#begin(name);
    const note = part("#note");
    if (status.note !== known && note !== document.activeElement) note.value = status.note;
    if (status.film !== this.#film) this.#load(status.film);
    this.#allow();
    this.#showResults(status);
  }

  /** Empty what belonged to the trial before. */
  #begin(name) {
    this.#trial = name;
    part("#note").value = "";
    part("#reason").value = "";
    for (const choice of document.querySelectorAll("[name=holds]")) choice.checked = false;
  }

  /** Where in the film a press belongs; nothing before it was wound from its beginning. */
  get #moment() {
    const time = part("#film").hidden ? 0 : part("video").currentTime;
    return time > 0 ? { time_s: time } : {};
  }

  /** A film that was fetched whole can be wound to any moment. */
  async #load(address) {
    this.#film = address;
    const video = part("video");
    URL.revokeObjectURL(video.src);
    video.removeAttribute("src");
    if (!address) return;
    const film = await (await fetch(address)).blob();
    if (address === this.#film) video.src = URL.createObjectURL(film);
  }

  /** Show what may be done now, to who may do it. */
  #allow() {
    if (!this.#status) return;
    const { phase, stage, stages, panel, sheet, film, reasons } = this.#status;
    const isPlacing = ["placing", "ready"].includes(phase);
    this.#panel.show(panel, this.#isDriver);
    const isJudging = this.#isDriver && phase === "judging";
    part("#closing").hidden = part("#spoiled").hidden = !isJudging;
    part("#at-end").hidden = stage !== stages.length;
    part("#finish").disabled = reasons.length > 0; // it cannot count
    part("#trial").hidden = phase === "over";
    part("#film").hidden = !isJudging || !film;
    part(".scroller").hidden = !part("#film").hidden;
    part(".trials").dataset.phase = phase;
    part("#overlay").hidden = part("#objects").hidden = !isPlacing;
    part(".sheet").hidden = !sheet || !isPlacing;
    if (sheet) part(".sheet a").href = sheet;
    this.#judging.isOpen = this.#isDriver && ["playing", "judging"].includes(phase);
    this.#judging.show(this.#status);
  }

  /** What is offered to why a trial does not count. */
  #showReasons(reasons) {
    const text = JSON.stringify(reasons);
    const list = part("#reasons");
    if (text === list.dataset.shown) return;
    list.dataset.shown = text;
    list.replaceChildren(...reasons.map((value) => make("option", { value })));
  }

  #showVariants(variants) {
    const words = Object.entries(variants).map(([name, value]) => `${name}: ${value}`);
    write(".variants", words.length ? `Choose: ${words.join(", ")}` : "");
  }

  #showFootprints(footprints) {
    const text = JSON.stringify(footprints);
    if (text === this.#table) return;
    this.#table = text;
    const rows = footprints.map((each) =>
      make(
        "tr",
        {},
        make("td", { class: "right" }, String(each.number)),
        make("th", { scope: "row" }, each.name),
        ...[each.x_mm, each.y_mm, each.yaw_deg].map((value) =>
          make("td", { class: "right" }, value.toFixed(1)),
        ),
      ),
    );
    part("#footprints tbody").replaceChildren(...rows);
  }

  #showResults({ results, files, phase }) {
    part("#over").hidden = phase !== "over" || !results;
    if (!results) return;
    const rows = results.map((each) => {
      const right = [`${each.successes} of ${each.episodes}`, percent(each.success_rate)];
      return make(
        "tr",
        {},
        make("th", { scope: "row" }, each.letter),
        make("td", {}, each.policy),
        make("td", {}, each.trained_on || "–"),
        ...right.map((value) => make("td", { class: "right" }, value)),
        make("td", {}, each.wilson_95.map(percent).join("–")),
        make("td", { class: "right" }, each.mean_final_progress.toFixed(2)),
      );
    });
    part("#over tbody").replaceChildren(...rows);
    write(".where-files", files);
  }

  #showRole({ role }) {
    this.#isDriver = role === "driver";
    const place = part(".role");
    const words = this.#isDriver ? "You operate the arms" : "You watch";
    const button = make("button", { type: "button" }, "Take over");
    place.replaceChildren(words, ...(this.#isDriver ? [] : [" ", button]));
    this.#allow();
  }

  #link(isConnected) {
    const isOver = this.#status?.phase === "over";
    const lost = isOver ? "The session is over" : "Connection lost: the arms are held";
    write(".link", isConnected ? "Connected" : lost);
    part(".link").dataset.state = isConnected || isOver ? "good" : "bad";
  }

  #say(text) {
    write(".note", text);
  }
}

function part(selector) {
  return document.querySelector(selector);
}

function write(selector, text) {
  const element = part(selector);
  const words = text ?? "";
  if (element.textContent !== words) element.textContent = words;
  if (element.matches(".note, .problem, .instruction, .variants")) element.hidden = !words;
}

function percent(share) {
  return (100 * share).toFixed(1);
}

new Trials();
