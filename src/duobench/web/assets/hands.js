// Both hands of the operator, and the one message in which every device speaks of them.
//
// Metres, radians, the world frame (z up), quaternions (w, x, y, z). Poses are relative: only what
// changes while a hand is squeezed moves a tool.

import { Latency } from "./latency.js";

const PERIOD_MS = 1000 / 60; // between two messages
const STALL_MS = 250; // a page that stood still for longer lets go: nobody steered meanwhile
const MEANT = 0.05; // a squeeze or trigger of a controller that is no rest
const BACKLOG_BYTES = 1024; // what may wait in the socket; more would arrive stale

const multiply = ([a, b, c, d], [w, x, y, z]) => [
  a * w - b * x - c * y - d * z,
  a * x + b * w + c * z - d * y,
  a * y - b * z + c * w + d * x,
  a * z + b * y - c * x + d * w,
];

/** The hand that mouse, keys and gamepad move in place of a real one. */
export class Hand {
  #position = [0, 0, 0];
  #rotation = [1, 0, 0, 0];
  #holders = new Map(); // device → time at which it lets go by itself
  #triggers = new Map(); // device → 0..1
  #start = null; // the pose at which the hand was squeezed, until a message has said it
  #moved = false; // since the last message
  #acting = new Set(); // devices that did something since the last message

  /** Squeeze the hand, until the device releases it or the clock shows `until`, in ms. */
  hold(device, until = Infinity) {
    if (!this.#holders.size) this.#start ??= [...this.#position, ...this.#rotation];
    this.#holders.set(device, until);
    this.#acting.add(device);
  }

  release(device) {
    this.#holders.delete(device);
  }

  isHeldBy(device) {
    return this.#holders.has(device);
  }

  /** Release the hand at once, and forget what no message has said. */
  letGo() {
    this.#holders.clear();
    this.#acting.clear();
    this.#start = null;
    this.#moved = false;
  }

  /** Move by a displacement in metres along the axes of the world. */
  move(shift) {
    this.#position = this.#position.map((value, axis) => value + shift[axis]);
    this.#moved = true;
  }

  /** Turn by an angle about an axis of length one, given in the world. */
  turn(axis, angle) {
    const [x, y, z] = axis.map((value) => value * Math.sin(angle / 2));
    const turned = multiply([Math.cos(angle / 2), x, y, z], this.#rotation);
    const length = Math.hypot(...turned);
    this.#rotation = turned.map((value) => value / length);
    this.#moved = true;
  }

  get trigger() {
    return Math.max(0, ...this.#triggers.values());
  }

  /** Close the gripper by a device's share, 0 open to 1 closed; the device that says most wins. */
  press(device, value) {
    if (value !== (this.#triggers.get(device) ?? 0)) this.#acting.add(device);
    this.#triggers.set(device, value);
  }

  /** Let go, with an open gripper. */
  open() {
    this.letGo();
    this.#triggers.clear();
  }

  /** Devices that have moved or pressed since the last message: "gamepad", or "mouse" with keys. */
  takeActing() {
    const acting = [...this.#acting, ...this.#holders.keys()];
    this.#acting.clear();
    return acting.map((device) => (device === "gamepad" ? "gamepad" : "mouse"));
  }

  /**
   * The hand as the next message says it.
   *
   * A squeeze is first said at the pose where it began, and a movement before a quick release is
   * still said as squeezed, so that what happens between two messages is not lost.
   */
  sample(now) {
    for (const [device, until] of this.#holders) if (now >= until) this.#holders.delete(device);
    const start = this.#start;
    this.#start = null;
    const squeeze = start || this.#holders.size || this.#moved ? 1 : 0;
    if (!start) this.#moved = false;
    const pose = start ?? [...this.#position, ...this.#rotation];
    const buttons = { keep: false, discard: false, restore: false, recentre: false };
    return { pose, sure: true, squeeze, trigger: this.trigger, buttons };
  }
}

/** Whether a tracked hand does anything. */
const isActing = (hand) => hand !== null && (hand.squeeze > MEANT || hand.trigger > MEANT);

/** Collects what the devices do, and sends it while this page drives. */
export class Hands {
  /** Two tracked controllers, `{left, right}` as in a message, while a headset is worn. */
  tracked = null;
  /** Objects with `update(seconds, now)`, asked before each message. */
  devices = [];
  /** Called with "left" or "right" when another arm becomes the active one. */
  onActive = () => {};
  /** How long it takes from a message to the picture that shows what it did. */
  latency = new Latency();
  #virtual = { left: new Hand(), right: new Hand() };
  #socket;
  #active = "right";
  #isDriving = false;
  #ticked = -Infinity;
  #due = -Infinity;
  #seq = 0;

  /** `socket` has `send(text)` and `bufferedAmount`, as a WebSocket has. */
  constructor(socket) {
    this.#socket = socket;
    const stop = () => this.letGo();
    addEventListener("blur", stop);
    document.addEventListener("visibilitychange", stop);
  }

  get left() {
    return this.#virtual.left;
  }

  get right() {
    return this.#virtual.right;
  }

  /** The side that mouse, arrow keys and sticks move. */
  get active() {
    return this.#active;
  }

  set active(side) {
    if (side === this.#active) return;
    this.letGo();
    this.#active = side;
    this.onActive(side);
  }

  /** The hand of the active side. */
  get hand() {
    return this.#virtual[this.#active];
  }

  get isDriving() {
    return this.#isDriving;
  }

  set isDriving(value) {
    if (value === this.#isDriving) return;
    this.#isDriving = value;
    this.latency.forget();
    this.letGo();
  }

  letGo() {
    this.left.letGo();
    this.right.letGo();
  }

  /** Both hands let go and their grippers open, as an episode begins. */
  open() {
    this.left.open();
    this.right.open();
  }

  /** Send a message without a hand in it, such as "keep". */
  say(kind) {
    if (this.#isDriving) this.#socket.send(JSON.stringify({ kind }));
  }

  /** Ask the devices and send a message where one is due; to be called all the time. */
  tick(now = performance.now()) {
    const elapsed = now - this.#ticked;
    this.#ticked = now;
    if (elapsed > STALL_MS) this.letGo();
    if (!this.#isDriving || (document.hidden && !this.tracked)) return; // nobody looks
    const seconds = elapsed > STALL_MS ? 0 : elapsed / 1000;
    for (const device of this.devices) device.update(seconds, now);
    if (now < this.#due || this.#socket.bufferedAmount > BACKLOG_BYTES) return;
    this.#due = Math.max(this.#due + PERIOD_MS, now);
    const isWorn = this.tracked && Object.values(this.tracked).some(isActing);
    const virtual = this.tracked ? [] : [...this.left.takeActing(), ...this.right.takeActing()];
    const devices = [...new Set(isWorn ? ["headset"] : virtual)];
    const { left, right } = this.tracked ?? {
      left: this.left.sample(now),
      right: this.right.sample(now),
    };
    const message = { kind: "hands", sent: now, seq: this.#seq++, left, right, devices };
    this.#socket.send(JSON.stringify(message));
    this.latency.sent(now);
  }
}
