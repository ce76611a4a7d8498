// A second look at recorded takes: their list, and what a person says about the one that is shown.

import { make } from "./controls.js";

const COLUMNS = {
  Take: ({ title }) => title,
  Operator: ({ take }) => take.operator,
  Device: ({ take }) => take.device,
  "Led / s": ({ take }) => take.led_s,
  Stage: ({ take }) => take.stage / Math.max(1, take.max_stage),
  End: ({ take }) => take.end,
  Use: ({ take }) => use(take),
  Note: ({ take }) => take.note,
};
const SHOWN = {
  "all takes": () => true,
  kept: ({ kept }) => kept,
  "not to be used": ({ kept }) => !kept,
  "kept, not exported": ({ kept, exported }) => kept && !exported,
  "looked at again": ({ at }) => at !== "",
};
const UNSOLVED = "Exports leave people's takes without success out, unless asked for them.";
const RATE_HZ = 30;
const NAME = "reviewer"; // where the browser remembers who looks

/** Whether a take is used, in words. */
function use({ kept, exported, rows }) {
  if (!kept) return "not to be used";
  const words = ["kept", rows && "trimmed", !exported && "not exported"];
  return words.filter(Boolean).join(", ");
}

function seconds(row) {
  return (row / RATE_HZ).toFixed(1);
}

function button(text, key, act) {
  const children = key ? [`${text} `, make("kbd", {}, key)] : [text];
  const made = make("button", { type: "button" }, ...children);
  made.addEventListener("click", act);
  return made;
}

function field(label, attributes) {
  const input = make("input", { type: "text", autocomplete: "off", ...attributes });
  return [input, make("label", {}, label, input)];
}

function choice(label, options) {
  const select = make("select");
  select.append(...options.map((text) => new Option(text)));
  return [select, make("label", {}, label, select)];
}

/** Fills the page; `tell` sends a message to the server. */
export class Takes {
  #tell;
  #items = [];
  #shown = []; // those of the list, in its order
  #selected = null;
  #order = ["Take", 1];
  #page;
  #panel;
  #list;
  #trims = [make("i", { class: "trim" }), make("i", { class: "trim" })];

  constructor(page, tell) {
    this.#page = page;
    this.#tell = tell;
    const style = make("link", { rel: "stylesheet", href: "/takes.css" });
    page.head.append(style);
    this.#buildPanel(page.querySelector("#take"));
    this.#buildList(page.querySelector("#takes"));
    page.querySelector(".timeline .line").append(...this.#trims);
    page.addEventListener("keydown", (event) => this.#press(event));
  }

  /** Show the takes as they stand now. */
  show(items, selected) {
    const isOther = selected !== this.#selected;
    const isNew = items !== this.#items;
    [this.#items, this.#selected] = [items, selected];
    if (isNew) this.#showList();
    else if (isOther) this.#mark();
    if (isNew || isOther) this.#showPanel(isOther);
    this.#showTrims();
  }

  get #take() {
    return this.#items.find(({ id }) => id === this.#selected)?.take;
  }

  get #slider() {
    return this.#page.querySelector(".timeline input");
  }

  /** Last row of the take, or 0 where it cannot be shown. */
  get #last() {
    return this.#page.querySelector(".timeline").hidden ? 0 : Number(this.#slider.max);
  }

  // --- the take that is shown ------------------------------------------------------------------

  #buildPanel(place) {
    place.hidden = false;
    const [note, noted] = field("Note", { maxlength: 500 });
    const [name, named] = field("Your pseudonym", { maxlength: 100 });
    const form = make("form", {}, noted, make("button", {}, "Write"));
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.#say({ note: note.value.trim() });
    });
    name.value = localStorage.getItem(NAME) ?? "";
    name.addEventListener("change", () => localStorage.setItem(NAME, name.value.trim()));
    const parts = {
      title: make("h2"),
      facts: make("p", { role: "status" }),
      reason: make("p", { class: "soft small" }),
      keep: button("Keep", "Y", () => this.#say({ kept: true })),
      discard: button("Discard", "Backspace", () => this.#say({ kept: false })),
      undo: button("Undo", "P", () => this.#say({ undo: true })),
      rows: make("p"),
      begin: button("Begin here", "I", () => this.#trim(0)),
      end: button("End here", "O", () => this.#trim(1)),
      whole: button("All of it", "", () => this.#say({ rows: [0, this.#last] })),
    };
    const { title, facts, reason, keep, discard, undo, rows, begin, end, whole } = parts;
    const said = "Files stay as they are: what is said stands beside them, in reviews.jsonl.";
    place.replaceChildren(
      ...[title, facts, reason, make("p", { class: "buttons" }, keep, discard, undo), form, rows],
      make("p", { class: "buttons" }, begin, end, whole),
      named,
      make("p", { class: "soft small" }, said),
    );
    this.#panel = { ...parts, note, name };
  }

  #showPanel(isOther) {
    const take = this.#take;
    if (!take) return;
    const { title, facts, reason, keep, discard, undo, note } = this.#panel;
    title.textContent = this.#items.find(({ id }) => id === this.#selected).title;
    const stage = `${take.end}, stage ${take.stage} of ${take.max_stage}`;
    const by = [take.operator, take.device].filter(Boolean).join(" with ");
    facts.textContent = `${use(take)} · ${stage} · ${by} · led for ${take.led_s.toFixed(1)} s`;
    const when = take.at.replace("T", " ").slice(0, 16);
    const who = take.at ? `Said last: ${take.by || "somebody"}, ${when} UTC.` : "";
    const why = take.kept ? (take.exported ? "" : UNSOLVED) : take.reason;
    reason.textContent = [why, who].filter(Boolean).join(" ");
    keep.setAttribute("aria-pressed", take.kept);
    discard.setAttribute("aria-pressed", !take.kept);
    undo.disabled = take.at === "";
    if (isOther || this.#page.activeElement !== note) note.value = take.note;
  }

  #showTrims() {
    const { rows: words, begin, end, whole } = this.#panel;
    const last = this.#last;
    const used = this.#take?.rows ?? [0, last];
    const isShown = last > 0;
    words.textContent = isShown ? `Used: ${seconds(used[0])} to ${seconds(used[1])} s` : "";
    for (const each of [begin, end]) each.disabled = !isShown;
    whole.disabled = !isShown || (used[0] === 0 && used[1] === last);
    const shares = [used[0] / Math.max(1, last), 1 - used[1] / Math.max(1, last)];
    this.#trims.forEach((trim, index) => {
      trim.style.setProperty("--share", String(isShown ? shares[index] : 0));
    });
  }

  #trim(which) {
    if (!this.#last) return;
    const rows = [...(this.#take.rows ?? [0, this.#last])];
    rows[which] = Number(this.#slider.value);
    this.#say({ rows });
  }

  #say(said) {
    if (!this.#take || (said.undo && !this.#take.at)) return;
    const by = this.#panel.name.value.trim();
    this.#tell({ kind: "review", id: this.#selected, by, ...said });
  }

  // --- the list --------------------------------------------------------------------------------

  #buildList(place) {
    place.hidden = false;
    const [task, tasks] = choice("Task", []);
    const [operator, operators] = choice("Operator", []);
    const [which, shown] = choice("Show", Object.keys(SHOWN));
    for (const each of [task, operator, which]) {
      each.addEventListener("change", () => this.#showList());
    }
    const count = make("p", { role: "status" });
    const heads = Object.keys(COLUMNS).map((name) => {
      const sort = button(name, "", () => {
        this.#order = [name, this.#order[0] === name ? -this.#order[1] : 1];
        this.#showList();
      });
      return make("th", { scope: "col" }, sort);
    });
    const body = make("tbody");
    const table = make("table", {}, make("thead", {}, make("tr", {}, ...heads)), body);
    const scroller = make("div", { class: "scroller" }, table);
    const keys = make("p", { class: "soft small" });
    keys.append("Keys: ", make("kbd", {}, ","), make("kbd", {}, "."), " the take before and after, ");
    keys.append(make("kbd", {}, "Space"), " plays.");
    const filters = make("div", { class: "filters" }, tasks, operators, shown);
    place.replaceChildren(make("h2", {}, "Takes"), filters, count, keys, scroller);
    this.#list = { task, operator, which, count, heads, body, scroller };
  }

  #showList() {
    const { task, operator, which, count, heads, body } = this.#list;
    this.#offer(task, "all tasks", ({ take }) => take.task);
    this.#offer(operator, "all operators", ({ take }) => take.operator);
    const isShown = ({ take }) =>
      (task.selectedIndex === 0 || take.task === task.value) &&
      (operator.selectedIndex === 0 || take.operator === operator.value) &&
      SHOWN[which.value](take);
    const [column, direction] = this.#order;
    const key = COLUMNS[column];
    const compare = (a, b) => (key(a) < key(b) ? -direction : key(a) > key(b) ? direction : 0);
    this.#shown = this.#items.filter(isShown).sort(compare);
    const takes = this.#shown.map(({ take }) => take);
    const kept = takes.filter(({ kept: isKept }) => isKept);
    const led = kept.reduce((sum, { led_s: own }) => sum + own, 0) / 60;
    const exported = kept.filter(({ exported: isExported }) => isExported).length;
    count.textContent =
      `${takes.length} of ${this.#items.length} takes · ${kept.length} kept, ` +
      `${exported} of them exported · ${led.toFixed(1)} minutes led`;
    const sorts = { 1: "ascending", "-1": "descending" };
    heads.forEach((head) => {
      const isSorted = head.textContent === column;
      head.setAttribute("aria-sort", isSorted ? sorts[direction] : "none");
    });
    const focused = body.contains(this.#page.activeElement) && this.#page.activeElement.dataset.take;
    body.replaceChildren(...this.#shown.map((item) => this.#row(item)));
    this.#mark();
    if (focused) this.#buttonOf(focused)?.focus({ preventScroll: true });
  }

  /** Options of a filter: everything, and what there is. */
  #offer(select, all, of) {
    const there = [...new Set(this.#items.map(of))].sort();
    const texts = [all, ...there];
    if (texts.join("\n") === [...select.options].map(({ text }) => text).join("\n")) return;
    const chosen = select.selectedIndex > 0 ? select.value : all;
    select.replaceChildren(...texts.map((text) => new Option(text)));
    select.value = texts.includes(chosen) ? chosen : all;
  }

  #row({ id, title, take }) {
    const choose = button(title, "", () => this.#tell({ kind: "select", id }));
    choose.dataset.take = id;
    const stage = `${take.stage} of ${take.max_stage}`;
    const led = take.led_s.toFixed(1);
    const by = [take.operator, take.device].filter(Boolean).join(" with ");
    const parts = [by, `${led} s`, `stage ${stage}`, take.end, take.note];
    const more = make("span", { class: "more" }, parts.filter(Boolean).join(" · "));
    const cells = [take.operator, take.device, led, stage, take.end, use(take), take.note];
    const row = make("tr", { "data-use": take.exported ? "used" : "unused" });
    row.append(make("th", { scope: "row" }, choose, more), ...cells.map((text) => make("td", {}, text)));
    return row;
  }

  #buttonOf(id) {
    return [...this.#list.body.querySelectorAll("button")].find(({ dataset }) => dataset.take === id);
  }

  #mark() {
    for (const each of this.#list.body.querySelectorAll("[aria-current]")) {
      each.removeAttribute("aria-current");
    }
    const chosen = this.#buttonOf(this.#selected);
    chosen?.setAttribute("aria-current", "true");
    const row = chosen?.closest("tr");
    if (!row) return;
    const { scroller } = this.#list;
    const [top, bottom] = [row.offsetTop - 2 * row.offsetHeight, row.offsetTop + row.offsetHeight];
    if (top < scroller.scrollTop) scroller.scrollTop = top;
    else if (bottom > scroller.scrollTop + scroller.clientHeight) {
      scroller.scrollTop = bottom - scroller.clientHeight;
    }
  }

  #move(by) {
    const place = this.#shown.findIndex(({ id }) => id === this.#selected);
    const next = this.#shown[place < 0 ? 0 : place + by];
    if (next) this.#tell({ kind: "select", id: next.id });
  }

  #press(event) {
    const isTyping = event.target.matches("input[type=text], select");
    if (isTyping || event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
    const isButton = event.target.matches("button, summary, a");
    const acts = {
      y: () => this.#say({ kept: true }),
      Backspace: () => this.#say({ kept: false }),
      p: () => this.#say({ undo: true }),
      i: () => this.#trim(0),
      o: () => this.#trim(1),
      ",": () => this.#move(-1),
      ".": () => this.#move(1),
    };
    if (!isButton) acts[" "] = () => this.#page.querySelector(".timeline .play").click();
    const act = acts[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }
}
