// A run that goes on: what it adds up to so far, how long it takes, and its latest failures.

import { make } from "./controls.js";

function time(seconds) {
  if (seconds === null || seconds === undefined) return "unknown";
  const minutes = Math.round(seconds / 60);
  if (minutes < 1) return `${Math.round(seconds)} s`;
  return minutes < 60 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

function table(rows) {
  const heads = ["Task", "Finished", "Successes", "95 %"];
  const head = make("tr", {}, ...heads.map((text) => make("th", { scope: "col" }, text)));
  const body = rows.map(({ condition, task, of, episodes, successes, wilson_95: interval }) => {
    const rate = episodes ? interval.map((share) => Math.round(100 * share)).join("–") : "";
    const name = condition ? `${task}, ${condition}` : task;
    const cells = [`${episodes}/${of}`, successes, rate].map((text) => make("td", {}, `${text}`));
    return make("tr", {}, make("th", { scope: "row" }, name), ...cells);
  });
  return make("table", {}, make("thead", {}, head), make("tbody", {}, ...body));
}

/** Fill an element; `choose` is told the id of an episode that somebody wants to see. */
export function showRun(element, run, choose) {
  element.hidden = false;
  if (run.note) return element.replaceChildren(make("p", { role: "status" }, run.note));
  const { finished, of, elapsed_s: elapsed, left_s: left, rows, failures } = run;
  const words = `${finished} of ${of} episodes in ${time(elapsed)}; ${time(left)} left`;
  const buttons = failures.map(({ id, title }) => {
    const button = make("button", { type: "button" }, title);
    button.addEventListener("click", () => choose(id));
    return make("li", {}, button);
  });
  const latest = buttons.length
    ? [make("h2", {}, "Latest failures"), make("ul", { class: "items" }, ...buttons)]
    : [];
  element.replaceChildren(make("p", { role: "status" }, words), table(rows), ...latest);
}
