// The page of a server: shows its frames and status, and lets people drive where it takes hands.

import { Cameras } from "./cameras.js";
import { Connection } from "./connection.js";
import { Insets } from "./insets.js";
import { Marks } from "./marks.js";
import { Notices } from "./notices.js";
import { Status } from "./status.js";
import { View } from "./view.js";
import { Views } from "./views.js";

const PING_MS = 250;
const POSE = 7; // numbers of a body
const FRAME_HEAD = 24; // bytes of a frame before its poses

/** What comes from the server, on the page. */
class Live {
  #canvas;
  #view;
  #status;
  #cameras;
  #connection;
  #scene = null; // name of the one that is shown
  #waiting = null; // poses that came before their scene
  #inputs = null; // what drives, once it was loaded
  #hands = null; // a part of it
  #insets;
  #marks;
  #notices;
  #views;
  #saysStages = false; // whether digits are for something else than views
  #latency = null; // of what drives
  #run = null; // what shows a run that goes on, once it was loaded
  #takes = null; // what takes a second look at recordings, once it was loaded
  #items = [];
  #selected = null;

  constructor() {
    const canvas = document.querySelector("canvas");
    this.#canvas = canvas;
    this.#view = new View(canvas);
    const isCovered = () => this.#view.isCovered();
    const cameras = document.querySelector("#cameras");
    this.#cameras = new Cameras(cameras, isCovered);
    this.#insets = new Insets(cameras);
    const screen = document.querySelector(".screen");
    this.#marks = new Marks(screen);
    this.#notices = new Notices(screen);
    this.#notices.onSilence = (isSilent) => isSilent && this.#status.showPing(null);
    this.#insets.mark = (...where) => this.#marks.into(...where);
    this.#view.onBegin = (gl) => this.#insets.paint(gl, this.#view.scene);
    this.#view.onDraw = () => this.#drawMarks();
    this.#connection = Connection.home();
    this.#status = new Status(document, (message) => this.#connection.tell(message));
    this.#connection.addEventListener("open", () => {
      this.#scene = null;
      this.#status.connected(true);
      this.#ping();
    });
    this.#connection.addEventListener("close", () => {
      this.#status.connected(false);
      this.#cameras.lost();
    });
    this.#connection.addEventListener("message", ({ data }) => {
      this.#notices.heard();
      if (typeof data === "string") this.#receive(JSON.parse(data));
      else this.#place(data);
    });
    setInterval(() => this.#ping(), PING_MS);
  }

  #receive(message) {
    if (message.kind === "scene") this.#load(message);
    else if (message.kind === "status") {
      this.#status.show(message);
      this.#selected = message.selected;
      this.#offer();
      if (message.run) this.#follow(message);
      this.#saysStages = Boolean(message.says_stages);
      this.#notices.taken(this.#status.taken);
      this.#limit(message.limited ?? {});
      if (message.clutch && !this.#inputs) this.#inputs = this.#loadInputs();
    } else if (message.kind === "items") {
      this.#items = message.items;
      this.#offer();
    } else if (message.kind === "cameras") this.#cameras.show(message.cameras);
    else if (message.kind === "role") {
      this.#status.showRole(message);
      this.#notices.taken(this.#status.taken);
      this.#drawMarks();
    } else if (message.kind === "pong") this.#status.showPing(performance.now() - message.sent);
    else if (message.kind === "refused") this.#status.say(message.reason);
  }

  async #load({ name, url }) {
    if (name === this.#scene) return;
    this.#scene = name;
    this.#waiting = null;
    try {
      const place = new URL(url, location.href);
      place.search ||= location.search;
      const answer = await fetch(place);
      if (!answer.ok) throw new Error(`The server has no scene ${name} (${answer.status}).`);
      const file = await answer.arrayBuffer();
      if (name !== this.#scene) return; // another one came meanwhile
      await this.#view.load(file);
      const { cameras } = this.#view.scene.header;
      this.#insets.build(cameras);
      if (this.#views && cameras) this.#views.cameras = cameras;
      if (this.#waiting) this.#view.scene.setPoses(this.#waiting);
    } catch (error) {
      this.#status.fail(error.message);
    }
  }

  #place(frame) {
    const head = new DataView(frame);
    const count = POSE * head.getUint32(12, true);
    const poses = new Float32Array(frame, FRAME_HEAD, count);
    this.#waiting = poses;
    this.#marks.place(new Float32Array(frame, FRAME_HEAD + 4 * count));
    const isNew = this.#view.scene.setPoses(poses);
    if (isNew) this.#views?.follow();
    this.#status.showStep(head.getUint32(8, true));
    if (isNew) this.#latency?.arrived(head.getFloat64(16, true));
  }

  /** What drives is loaded only where the server takes hands. */
  async #loadInputs() {
    const { startInputs } = await import("./inputs.js");
    const { hands, headset } = startInputs({
      scene: this.#view.scene,
      orbit: this.#view.orbit,
      socket: this.#connection,
      status: document.querySelector("#inputs"),
      element: document.querySelector("canvas"),
    });
    this.#view.isCovered = () => headset.isWorn;
    this.#latency = hands.latency;
    this.#view.onDraw = () => {
      this.#drawMarks();
      hands.latency.drawn((call) => requestAnimationFrame(call));
    };
    headset.pictures = (gl, isAlways) => this.#insets.pictures(gl, this.#view.scene, isAlways);
    const mark = hands.onActive;
    hands.onActive = () => {
      mark();
      this.#views.lead();
      this.#drawMarks();
    };
    this.#hands = hands;
    this.#view.scene.isLitFromAbove = true;
    this.#views = new Views({
      bar: document.querySelector(".views"),
      page: document.querySelector("main"),
      orbit: this.#view.orbit,
      active: () => hands.lead,
      tool: (side) => this.#marks.tool(side),
      takesDigits: () => !this.#saysStages,
    });
    this.#views.cameras = this.#view.scene.header?.cameras ?? [];
    this.#status.latency = () => hands.latency.ms;
    this.#status.canBeDriven();
    this.#drawMarks();
  }

  #limit(limited) {
    this.#marks.limited = limited;
    this.#notices.limit(limited);
    this.#drawMarks();
  }

  #drawMarks() {
    const canvas = this.#canvas;
    const active = this.#status.isDriver && this.#hands ? this.#hands.sides : [];
    this.#marks.active = this.#insets.active = active;
    this.#marks.draw(this.#view.orbit, canvas.clientWidth, canvas.clientHeight);
  }

  /** What can be chosen; a second look at takes is loaded only where there are some. */
  async #offer() {
    if (!this.#items[0]?.take) return this.#status.offer(this.#items, this.#selected);
    const tell = (message) => this.#connection.tell(message);
    this.#takes ??= import("./takes.js").then(({ Takes }) => new Takes(document, tell));
    (await this.#takes).show(this.#items, this.#selected);
  }

  /** A run that goes on; what shows it is loaded only where there is one. */
  async #follow({ run, report, ended }) {
    if (ended) {
      this.#connection.end();
      this.#notices.heard(false);
    }
    if (report) return location.replace(report);
    this.#run ??= import("./run.js");
    const { showRun } = await this.#run;
    showRun(document.querySelector("#run"), run, (id) =>
      this.#connection.tell({ kind: "select", id }),
    );
  }

  #ping() {
    this.#connection.tell({ kind: "ping", sent: performance.now() });
  }
}

try {
  new Live();
} catch (error) {
  const problem = document.querySelector(".problem");
  problem.textContent = error.message;
  problem.hidden = false;
}
