// What stands under a scene: stage chips, and a slider with marks where stages were reached.

const SPEEDS = [0.25, 0.5, 1, 2, 4];

/** An element with attributes and children. */
export function make(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

/** Stage after the last change at or before a step; changes are pairs of step and stage. */
export function stageAt(changes, step) {
  return changes.reduce((stage, [at, next]) => (at <= step ? next : stage), 0);
}

/** One chip a stage; with `onChoose`, a chip whose stage was reached leads there. */
export class Chips {
  #list;
  #onChoose;
  #words = null;
  #chips = [];

  constructor(list, onChoose = null) {
    this.#list = list;
    this.#onChoose = onChoose;
  }

  /** Say what the stages are, and which are reached now and which ever. */
  show(words, stage, reached = stage) {
    if (JSON.stringify(words) !== JSON.stringify(this.#words)) this.#build(words);
    this.#chips.forEach((chip, index) => {
      const number = index + 1;
      const state = number <= stage ? "reached" : number <= reached ? "later" : "open";
      if (chip.dataset.state === state) return;
      chip.dataset.state = state;
      const said = { reached: "reached", later: "reached later", open: "not reached" }[state];
      chip.querySelector(".reading").textContent = `, ${said}`;
      if (this.#onChoose) chip.disabled = number > reached;
    });
  }

  #build(words) {
    this.#words = words;
    this.#chips = words.map((word, index) => {
      const parts = [
        make("b", {}, String(index + 1)),
        make("span", { class: "word" }, word),
        make("span", { class: "reading hidden" }),
      ];
      if (!this.#onChoose) return make("span", { class: "stage-chip" }, ...parts);
      const chip = make("button", { class: "stage-chip", type: "button" }, ...parts);
      chip.title = "Go to where this stage was reached";
      chip.addEventListener("click", () => this.#onChoose(index + 1));
      return chip;
    });
    this.#list.replaceChildren(...this.#chips.map((chip) => make("li", {}, chip)));
    this.#list.hidden = words.length === 0;
  }
}

/** Play and pause, a slider over the steps, the time, and the speed where `hasSpeed`. */
export class Timeline {
  /** Called with the step that somebody chose. */
  onSeek = () => {};
  /** Called with whether it shall play. */
  onPlay = () => {};
  speed = 1;
  #play = make("button", { type: "button", class: "play" });
  #slider = make("input", { type: "range", min: "0", step: "1", "aria-label": "Time" });
  #marks = make("div", { class: "marks", "aria-hidden": "true" });
  #time = make("span", { class: "time" });
  #content = { steps: 1, rate: 30, changes: [], last: 0 };
  #isPlaying = false;

  constructor(place, { hasSpeed = true } = {}) {
    const line = make("div", { class: "line" }, this.#marks, this.#slider);
    place.append(this.#play, line, this.#time);
    if (hasSpeed) place.append(this.#speeds());
    this.#play.addEventListener("click", () => this.onPlay(!this.#isPlaying));
    this.#slider.addEventListener("input", () => this.onSeek(Number(this.#slider.value)));
    this.isPlaying = false;
  }

  /**
   * What is played: number of steps, steps a second, pairs of step and stage, last stage, and
   * stretches [from, to, why] that a person led in the place of a policy.
   */
  set content(content) {
    this.#content = content;
    const end = Math.max(1, content.steps - 1);
    this.#slider.max = String(end);
    const marks = content.changes.map(([step, stage]) => {
      const mark = make("i", {}, String(stage));
      mark.style.setProperty("--at", String(Math.min(1, step / end)));
      return mark;
    });
    const bars = (content.spans ?? []).map(([from, to]) => {
      const bar = make("b", {});
      bar.style.setProperty("--at", String(from / end));
      bar.style.setProperty("--to", String(to / end));
      return bar;
    });
    this.#marks.replaceChildren(...bars, ...marks);
  }

  set isPlaying(isPlaying) {
    this.#isPlaying = isPlaying;
    this.#play.textContent = isPlaying ? "Pause" : "Play";
    this.#play.dataset.state = isPlaying ? "pause" : "play";
  }

  get isPlaying() {
    return this.#isPlaying;
  }

  /** Show a step, which need not be a whole number. */
  set step(step) {
    const { steps, rate, changes, last } = this.#content;
    const seconds = (value) => `${(value / rate).toFixed(1)} s`;
    const [now, end] = [seconds(step), seconds(Math.max(0, steps - 1))];
    const stage = stageAt(changes, step);
    this.#slider.value = String(Math.round(step));
    this.#slider.style.setProperty("--at", String(step / Math.max(1, steps - 1)));
    this.#slider.setAttribute("aria-valuetext", `${now} of ${end}, stage ${stage} of ${last}`);
    this.#time.textContent = `${now} / ${end}`;
  }

  #speeds() {
    const choice = make("select", { class: "speed", "aria-label": "Speed" });
    for (const speed of SPEEDS) choice.append(new Option(`${speed} ×`, speed, speed === 1));
    choice.value = "1";
    choice.addEventListener("change", () => (this.speed = Number(choice.value)));
    return choice;
  }
}
