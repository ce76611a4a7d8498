// What is drawn over the scene at each tool: a ring, its name, and a line down with the height.

const SVG = "http://www.w3.org/2000/svg";
const RADIUS = 0.03; // of a ring, in metres
const BOLD = 12; // pixels of a ring from which on marks are as bold as they get
const CORNERS = 24;
const NEAREST = 0.02; // metres before a camera, from which on something is drawn
const NUMBERS = 7; // of a tool: place, where its line begins, its length
const SIDES = ["left", "right"];
const COLOURS = { left: "#ff9a3c", right: "#4fb3ff" };
const NAMES = { left: "Left", right: "Right" };

/** Where points are in an image of `width` by `height`; null for one behind the camera. */
function seen(view, projection, width, height, [x, y, z]) {
  const at = [0, 1, 2].map((i) => view[i] * x + view[4 + i] * y + view[8 + i] * z + view[12 + i]);
  const depth = -at[2];
  if (depth < NEAREST) return null;
  const across = (projection[0] * at[0]) / depth;
  const above = (projection[5] * at[1]) / depth;
  return [((1 + across) * width) / 2, ((1 - above) * height) / 2];
}

/** How many pixels high a metre is at a point. */
function pixelsAMetre(view, projection, height, [x, y, z]) {
  const depth = -(view[2] * x + view[6] * y + view[10] * z + view[14]);
  return (projection[5] * height) / 2 / depth;
}

/** A level ring about a point. */
function ring([x, y, z], radius = RADIUS) {
  return Array.from({ length: CORNERS + 1 }, (_, i) => {
    const angle = (2 * Math.PI * i) / CORNERS;
    return [x + radius * Math.cos(angle), y + radius * Math.sin(angle), z];
  });
}

/** The lines of a tool: `{tool, line, ground}`, each a list of points. */
function linesOf({ tool, start, length }) {
  if (Number.isNaN(length)) return { tool: ring(tool), line: [], ground: [], cross: [] };
  const end = [start[0], start[1], start[2] - length];
  const cross = [0, 1].map((axis) =>
    [-1, 1].map((sign) => end.map((value, i) => value + (i === axis ? sign * RADIUS : 0))),
  );
  return { tool: ring(tool), line: [start, end], ground: ring(end), cross };
}

/** Marks of both tools over an element that shows what an orbit's camera sees. */
export class Marks {
  /** The arms that are led; their marks are the stronger ones. */
  active = [];
  /** Arms that are kept from where their hand wants them, `{left, right}`. */
  limited = {};
  #tools = {};
  #parts;

  constructor(place) {
    const svg = shape("svg", { class: "marks-of-tools", "aria-hidden": "true" });
    this.#parts = Object.fromEntries(SIDES.map((side) => [side, this.#build(svg, side)]));
    this.svg = svg;
    place.append(svg);
  }

  /** Take what comes with a frame: seven numbers a tool, or none. */
  place(rows) {
    this.#tools = {};
    SIDES.forEach((side, i) => {
      const row = [...rows.subarray(NUMBERS * i, NUMBERS * (i + 1))];
      if (row.length < NUMBERS) return;
      this.#tools[side] = { tool: row.slice(0, 3), start: row.slice(3, 6), length: row[6] };
    });
  }

  /** Place of a side's tool in the world, where it is known. */
  tool(side) {
    return this.#tools[side]?.tool;
  }

  /** Draw over the scene. */
  draw({ view, projection }, width, height) {
    const places = SIDES.map((side) => {
      const tool = this.tool(side);
      return tool && seen(view, projection, width, height, tool);
    });
    for (const [index, side] of SIDES.entries()) {
      const { group, shapes, label, name, number } = this.#parts[side];
      const tool = this.#tools[side];
      const [at, other] = [places[index], places[1 - index]];
      group.style.display = at ? "" : "none";
      if (!at) continue;
      group.dataset.state = this.active.includes(side) ? "active" : "other";
      group.dataset.limited = this.limited[side] ? "yes" : "";
      const size = RADIUS * pixelsAMetre(view, projection, height, tool.tool);
      group.style.setProperty("--bold", Math.min(1, size / BOLD));
      const lines = linesOf(tool);
      if (size < BOLD) lines.cross = []; // it would hide small things
      for (const [what, path] of Object.entries(shapes)) {
        path.setAttribute("d", pathOf(lines[what] ?? [], view, projection, width, height));
      }
      label.setAttribute("transform", `translate(${at[0].toFixed(1)} ${at[1].toFixed(1)})`);
      const room = this.limited[side] ? 170 : 90; // that words need
      const isOuter = other && at[0] > other[0] && width - at[0] > room; // away from the other's
      label.dataset.at = at[0] < room || isOuter ? "right" : "left";
      write(name, `${NAMES[side]}${this.limited[side] ? " · kept back" : ""}`);
      write(number, Number.isNaN(tool.length) ? "" : `${Math.round(1000 * tool.length)} mm`);
    }
  }

  /** Draw where each tool would land into a small picture. */
  into(pen, view, projection, width, height) {
    for (const side of SIDES) {
      const tool = this.#tools[side];
      if (!tool) continue;
      const { tool: top, line, ground, cross } = linesOf(tool);
      pen.globalAlpha = this.active.includes(side) ? 1 : 0.6;
      for (const points of [ground, line, top, ...cross]) {
        const places = points.map((point) => seen(view, projection, width, height, point));
        if (!places.length || places.includes(null)) continue;
        const path = new Path2D(`M${places.map((place) => place.join(" ")).join("L")}`);
        pen.lineWidth = 3;
        pen.strokeStyle = "#000a";
        pen.stroke(path);
        pen.lineWidth = 1.5;
        pen.strokeStyle = COLOURS[side];
        pen.stroke(path);
      }
    }
    pen.globalAlpha = 1;
  }

  #build(svg, side) {
    const group = shape("g", { "data-side": side, style: `--side: ${COLOURS[side]}` });
    const shapes = {};
    for (const what of ["ground", "cross", "line", "tool"]) {
      shapes[what] = shape("path", { class: what });
      const halo = shape("path", { class: "halo" });
      group.append(halo, shapes[what]);
      const set = shapes[what].setAttribute.bind(shapes[what]);
      shapes[what].setAttribute = (key, value) => {
        set(key, value);
        halo.setAttribute(key, value);
      };
    }
    const label = shape("g", { class: "label" });
    const name = shape("text", { class: "name", y: -4 });
    const number = shape("text", { class: "height", y: 15 });
    label.append(name, number);
    group.append(label);
    svg.append(group);
    return { group, shapes, label, name, number };
  }
}

/** A path through points, or through several lists of them, as an image shows them. */
function pathOf(points, view, projection, width, height) {
  if (Array.isArray(points[0]?.[0])) {
    return points.map((each) => pathOf(each, view, projection, width, height)).join("");
  }
  const places = points.map((point) => seen(view, projection, width, height, point));
  if (!places.length || places.includes(null)) return "";
  return `M${places.map((place) => place.map((value) => value.toFixed(1)).join(" ")).join("L")}`;
}

function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function shape(name, attributes) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}
