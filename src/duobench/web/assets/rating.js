// The page of a rater: one film after the other, with keys for stages.

import { Connection } from "./connection.js";
import { make } from "./controls.js";
import { Judging } from "./judging.js";

/** The page. */
class Rating {
  #connection = Connection.home();
  #judging = new Judging(document);
  #status = null;
  #film = "";

  constructor() {
    const connection = this.#connection;
    connection.addEventListener("open", () => {
      write(".link", "Connected");
      this.#tell("drive");
    });
    connection.addEventListener("close", () => {
      const isOver = this.#status?.phase === "over";
      write(".link", isOver ? "The session is over" : "Connection lost. Trying again …");
    });
    connection.addEventListener("message", ({ data }) => {
      if (typeof data === "string") this.#receive(JSON.parse(data));
    });
    this.#judging.onStage = (stage) => this.#tell("at", { time_s: this.#time, stage });
    this.#judging.onUndo = () => this.#tell("at", { time_s: this.#time, stage: null });
    part("#closing").addEventListener("submit", (event) => {
      event.preventDefault();
      const text = part("#note").value.trim().replace(/\s+/g, " ");
      if (text) this.#tell("note", { text });
      this.#tell("finish");
    });
    part(".role").addEventListener("click", (event) => {
      if (event.target.matches("button")) this.#tell("take_over");
    });
  }

  get #time() {
    return part("video").currentTime;
  }

  #tell(kind, fields = {}) {
    this.#connection.tell({ kind, ...fields });
  }

  #receive(message) {
    if (message.kind === "status") this.#show(message);
    else if (message.kind === "role") this.#showRole(message);
    else if (message.kind === "refused") write(".note", message.reason);
  }

  #show(status) {
    this.#status = status;
    document.title = `${status.title} · Rating · DuoBench`;
    write("h1", status.title);
    const isRating = status.phase === "rating";
    const where = isRating ? `Film ${status.number} of ${status.of} · ` : "";
    write(".where", `${where}rated by ${status.rater}`);
    write(".note", status.message);
    write(".instruction", isRating ? `“${status.instruction}”` : "");
    part("#film-and-keys").hidden = !isRating;
    this.#judging.isOpen = isRating;
    this.#judging.show(status);
    if (isRating && status.film !== this.#film) this.#load(status.film);
  }

  /** A film that was fetched whole can be wound to any moment. */
  async #load(address) {
    this.#film = address;
    part("#note").value = "";
    const video = part("video");
    const answer = await fetch(address);
    const film = await answer.blob();
    if (address !== this.#film) return; // another one came meanwhile
    URL.revokeObjectURL(video.src);
    video.src = URL.createObjectURL(film);
  }

  #showRole({ role, drivers }) {
    const isDriver = role === "driver";
    const button = make("button", { type: "button" }, "Take over");
    const rest = isDriver || !drivers ? [] : [" ", button];
    part(".role").replaceChildren(isDriver ? "You rate" : "You watch", ...rest);
  }
}

function part(selector) {
  return document.querySelector(selector);
}

function write(selector, text) {
  const element = part(selector);
  const words = text ?? "";
  if (element.textContent !== words) element.textContent = words;
  if (element.matches(".note, .instruction")) element.hidden = !words;
}

new Rating();
