// A camera on a sphere about the table, for mouse, touch and keys.

const NEAR = 0.03;
const FAR = 20;
const DISTANCE = [0.25, 4]; // metres
const ELEVATION = [-0.1, 1.55]; // radians; from a little below the table top to right above it
const REACH = 1.5; // metres from the robot to what the camera turns about, along each axis
const TURN = 0.007; // radians a pixel
const KEY_TURN = 0.1; // radians a press
const KEY_MOVE = 0.05; // of the distance
const WHEEL = 0.0015;
const WIDE = 4 / 3; // a narrower window sees as much to the sides as one of this shape
const ARROWS = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/** Turns by dragging, zooms by wheel and pinch, moves by Shift and dragging or by two fingers. */
export class Orbit {
  /** Called when something else is seen. */
  onChange = () => {};
  #element;
  #start = { eye: [2.35, -1.35, 1.42], target: [0.23, 0.04, 0.1], fovy: 37 };
  #fovy;
  #target;
  #distance;
  #azimuth;
  #elevation;
  #pointers = new Map();

  constructor(element) {
    this.#element = element;
    this.reset();
    const listen = (type, method) =>
      element.addEventListener(type, (event) => method.call(this, event), { passive: false });
    listen("pointerdown", this.#press);
    listen("pointermove", this.#move);
    for (const type of ["pointerup", "pointercancel"]) listen(type, this.#release);
    listen("wheel", this.#wheel);
    listen("keydown", this.#key);
    listen("contextmenu", (event) => event.preventDefault());
    listen("dblclick", () => this.reset());
  }

  /** Look from an eye to a target, in metres, with a vertical field of view in degrees. */
  look(start) {
    this.#start = start;
    this.reset();
  }

  /** Look as at first. */
  reset() {
    this.aim(this.#start);
  }

  /** Look from an eye to a target for now. */
  aim({ eye, target, fovy }) {
    this.#fovy = fovy;
    const [x, y, z] = eye.map((value, i) => value - target[i]);
    this.#target = [...target];
    this.#distance = Math.hypot(x, y, z);
    this.#azimuth = Math.atan2(y, x);
    this.#elevation = Math.asin(z / this.#distance);
    this.onChange();
  }

  /** Move eye and target in the world. */
  move(shift) {
    this.#target = this.#target.map((value, i) => clamp(value + shift[i], [-REACH, REACH]));
    this.onChange();
  }

  /** Right, up and forward of the camera in the world. */
  get right() {
    return [-Math.sin(this.#azimuth), Math.cos(this.#azimuth), 0];
  }

  get up() {
    const [c, s] = [Math.cos(this.#elevation), Math.sin(this.#elevation)];
    return [-Math.cos(this.#azimuth) * s, -Math.sin(this.#azimuth) * s, c];
  }

  get forward() {
    const [c, s] = [Math.cos(this.#elevation), Math.sin(this.#elevation)];
    return [-Math.cos(this.#azimuth) * c, -Math.sin(this.#azimuth) * c, -s];
  }

  get eye() {
    return this.#target.map((value, i) => value - this.#distance * this.forward[i]);
  }

  /** Eye from world, column by column. */
  get view() {
    const rows = [this.right, this.up, this.forward.map((value) => -value)];
    const shift = rows.map((row) => -row.reduce((sum, value, i) => sum + value * this.eye[i], 0));
    const columns = [0, 1, 2].flatMap((i) => [...rows.map((row) => row[i]), 0]);
    return new Float32Array([...columns, ...shift, 1]);
  }

  /** Clip from eye, column by column. */
  get projection() {
    const tangent = this.#tangent;
    const depth = 1 / (NEAR - FAR);
    return new Float32Array([
      ...[1 / (tangent * this.#aspect), 0, 0, 0],
      ...[0, 1 / tangent, 0, 0],
      ...[0, 0, (NEAR + FAR) * depth, -1],
      ...[0, 0, 2 * NEAR * FAR * depth, 0],
    ]);
  }

  /** Where a point of the element, in CSS pixels from its top left, looks: `{origin, direction}`. */
  ray(x, y) {
    const across = ((2 * x) / this.#element.clientWidth - 1) * this.#tangent * this.#aspect;
    const above = (1 - (2 * y) / this.#element.clientHeight) * this.#tangent;
    const { right, up, forward } = this;
    const direction = forward.map((value, i) => value + across * right[i] + above * up[i]);
    const length = Math.hypot(...direction);
    return { origin: this.eye, direction: direction.map((value) => value / length) };
  }

  get #aspect() {
    return this.#element.clientWidth / Math.max(1, this.#element.clientHeight);
  }

  get #tangent() {
    return Math.tan((this.#fovy * Math.PI) / 360) * Math.max(1, WIDE / this.#aspect);
  }

  #turn(across, down) {
    this.#azimuth -= across;
    this.#elevation = clamp(this.#elevation + down, ELEVATION);
    this.onChange();
  }

  #zoom(factor) {
    this.#distance = clamp(this.#distance * factor, DISTANCE);
    this.onChange();
  }

  /** Move by shares of what is seen from top to bottom. */
  #shift(across, down) {
    const size = 2 * this.#distance * this.#tangent;
    const { right, up } = this;
    this.move(right.map((value, i) => size * (up[i] * down - value * across)));
  }

  #press(event) {
    this.#element.focus({ preventScroll: true });
    this.#element.setPointerCapture(event.pointerId);
    this.#pointers.set(event.pointerId, [event.clientX, event.clientY]);
    event.preventDefault();
  }

  #move(event) {
    const before = this.#pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [across, down] = [now[0] - before[0], now[1] - before[1]];
    const height = this.#element.clientHeight;
    const others = [...this.#pointers].filter(([id]) => id !== event.pointerId);
    this.#pointers.set(event.pointerId, now);
    if (others.length > 0) {
      const other = others[0][1];
      const apart = (point) => Math.max(1, Math.hypot(point[0] - other[0], point[1] - other[1]));
      this.#zoom(apart(before) / apart(now));
      this.#shift(across / 2 / height, down / 2 / height);
    } else if (event.shiftKey || event.buttons === 4) {
      this.#shift(across / height, down / height);
    } else {
      this.#turn(across * TURN, down * TURN);
    }
  }

  #release(event) {
    this.#pointers.delete(event.pointerId);
  }

  /** Only with Ctrl, as a pinch on a touchpad has, or in focus: else the wheel scrolls the page. */
  #wheel(event) {
    if (!event.ctrlKey && document.activeElement !== this.#element) return;
    this.#zoom(Math.exp(event.deltaY * (event.deltaMode ? 33 : 1) * WHEEL));
    event.preventDefault();
  }

  #key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const arrow = ARROWS[event.key];
    if (arrow && event.shiftKey) this.#shift(...arrow.map((value) => value * KEY_MOVE));
    else if (arrow) this.#turn(-arrow[0] * KEY_TURN, arrow[1] * KEY_TURN);
    else if (event.key === "+" || event.key === "=") this.#zoom(0.9);
    else if (event.key === "-") this.#zoom(1 / 0.9);
    else if (event.key === "0") this.reset();
    else return;
    event.preventDefault();
  }
}

function clamp(value, [low, high]) {
  return Math.min(high, Math.max(low, value));
}
