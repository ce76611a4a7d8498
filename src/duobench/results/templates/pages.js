// Tables that sort, episodes that filter, videos that jump. Without it a page shows the same.

const SUMS = "tr.group, tr.category"; // rows of several others: hidden while a table is sorted
const LAST = "tr.all, tr.overall"; // stays below all others

function sortKey(row, column) {
  const cell = row.cells[column];
  const text = (cell.dataset.sort ?? cell.textContent).trim();
  const number = /^(?:<|about)?\s*([−+-]?[\d,]*\.?\d+)/.exec(text);
  const value = number ? Number(number[1].replace("−", "-").replaceAll(",", "")) : NaN;
  return { text, value, isEmpty: text === "" || text === "–" };
}

function compare(one, other, sign) {
  if (one.isEmpty || other.isEmpty) return one.isEmpty - other.isEmpty;
  if (!Number.isNaN(one.value) && !Number.isNaN(other.value)) {
    return sign * (one.value - other.value);
  }
  return sign * one.text.localeCompare(other.text, "en", { numeric: true });
}

function makeSortable(table) {
  const home = [...table.tBodies].flatMap((body) => [...body.rows].map((row) => [body, row]));
  const rows = home.map(([, row]) => row).filter((row) => !row.matches(`${SUMS}, ${LAST}`));
  if (rows.length < 2) return;
  const heads = [...[...table.tHead.rows].at(-1).cells];
  const sort = (head, column, order) => {
    for (const each of heads) each.removeAttribute("aria-sort");
    for (const row of table.querySelectorAll(SUMS)) row.hidden = Boolean(order);
    for (const [body, row] of home) body.append(row);
    if (!order) return;
    head.setAttribute("aria-sort", order);
    const sign = order === "ascending" ? 1 : -1;
    const keyed = rows.map((row) => [row, sortKey(row, column)]);
    keyed.sort(([, one], [, other]) => compare(one, other, sign));
    table.tBodies[0].append(...keyed.map(([row]) => row));
    for (const [body, row] of home) if (row.matches(LAST)) body.append(row);
  };
  for (const [column, head] of heads.entries()) {
    const keys = rows.map((row) => sortKey(row, column)).filter((key) => !key.isEmpty);
    if (!keys.length) continue;
    // Numbers begin with the largest, words with the first.
    const isNumber = keys.every((key) => !Number.isNaN(key.value));
    const orders = isNumber ? ["descending", "ascending"] : ["ascending", "descending"];
    const button = document.createElement("button");
    button.type = "button";
    button.className = "sort";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const now = head.getAttribute("aria-sort");
      sort(head, column, now ? orders[orders.indexOf(now) + 1] : orders[0]);
    });
  }
  for (const hint of table.querySelectorAll(".sorting")) hint.hidden = false;
}

// A number in a sentence is not what tells two constraints apart.
const plain = (text) => text.trim().replace(/(?<![\w.])-?\d+(?:\.\d+)?(?!\w)/g, "…");

function makeFilter(form) {
  const table = form.parentElement.querySelector("table");
  const rows = [...table.tBodies].flatMap((body) => [...body.rows]).map((row) => ({
    row,
    task: [row.dataset.task],
    stage: [row.dataset.stage],
    unmet: [...row.querySelectorAll(".constraint")].map((each) => plain(each.textContent)),
    title: row.cells[0].textContent,
    reached: row.querySelector(".stage").textContent,
  }));
  const selects = ["task", "stage", "unmet"].map((name) => form.elements[name]);
  const isShown = (each, but) =>
    !(form.elements.failed.checked && each.row.matches(".success")) &&
    selects.every((one) => one === but || !one.value || each[one.name].includes(one.value));

  const label = (select, value, found) => {
    if (select.name === "task") return found[0].title;
    const reached = new Set(found.map((each) => each.reached));
    return select.name === "stage" && reached.size === 1 ? `${value} ${[...reached][0]}` : value;
  };

  function choices(select) {
    const found = new Map();
    for (const each of rows.filter((one) => isShown(one, select))) {
      for (const value of new Set(each[select.name])) {
        if (!found.has(value)) found.set(value, []);
        found.get(value).push(each);
      }
    }
    const names = [...found.keys()];
    if (select.name === "unmet") names.sort((a, b) => found.get(b).length - found.get(a).length);
    if (select.name === "stage") names.sort((a, b) => a - b);
    const chosen = select.value;
    const options = names.map((name) => {
      const text = `${label(select, name, found.get(name))} (${found.get(name).length})`;
      return new Option(text, name, false, name === chosen);
    });
    select.replaceChildren(select.options[0], ...options);
    if (!found.has(chosen)) select.value = "";
  }

  function filter() {
    for (const select of selects) choices(select);
    let count = 0;
    for (const each of rows) {
      const shown = isShown(each);
      each.row.classList.toggle("filtered", !shown);
      count += shown;
    }
    form.elements.count.value = `${count} of ${rows.length} episodes`;
  }
  form.addEventListener("input", filter);
  form.addEventListener("reset", () => setTimeout(filter));
  form.addEventListener("submit", (event) => event.preventDefault());
  for (const link of document.querySelectorAll("a[data-stage]")) {
    link.addEventListener("click", () => {
      form.reset();
      filter();
      for (const select of selects) {
        select.value = link.dataset[select.name] ?? "";
        filter();
      }
    });
  }
  filter();
}

for (const button of document.querySelectorAll("button[data-time]")) {
  button.addEventListener("click", () => {
    const video = button.closest("figure").querySelector("video");
    video.currentTime = Number(button.dataset.time);
    video.pause();
  });
}

function reveal() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (target?.matches(".filtered")) {
    for (const form of document.querySelectorAll("form.filter")) form.reset();
    target.classList.remove("filtered");
  }
  const list = target?.closest("details");
  if (list && !list.open) {
    list.open = true;
    target.scrollIntoView();
  }
}
addEventListener("hashchange", reveal);
addEventListener("beforeprint", () => {
  for (const error of document.querySelectorAll("details.error")) error.open = true;
});
for (const table of document.querySelectorAll("table.sorts")) makeSortable(table);
for (const each of document.querySelectorAll(".filter")) each.hidden = false;
for (const form of document.querySelectorAll("form.filter")) makeFilter(form);
reveal();
