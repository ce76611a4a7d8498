// Both hands of the operator, and the one message in which every device speaks of them.
//
// Metres, radians, the world frame (z up), quaternions (w, x, y, z). Poses are relative: only what
// changes while a hand is squeezed moves a tool.

import { Latency } from "./latency.js";
import { Pair } from "./pair.js";
import { IDENTITY, multiply, quaternion } from "./turning.js";

const PERIOD_MS = 1000 / 60; // between two messages
const STALL_MS = 250; // a page that stood still for longer lets go: nobody steered meanwhile
const MEANT = 0.05; // a squeeze or trigger of a controller that is no rest
const BACKLOG_BYTES = 1024; // what may wait in the socket; more would arrive stale

/** The hand that mouse, keys and gamepad move in place of a real one. */
export class Hand {
  #position = [0, 0, 0];
  #rotation = IDENTITY;
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

  get isHeld() {
    return this.#holders.size > 0;
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
    const turned = multiply(quaternion(axis, angle), this.#rotation);
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

  /** Close the gripper further by a share, or open it by a negative one. */
  squeezeBy(device, share) {
    this.press(device, Math.min(1, Math.max(0, this.trigger + share)));
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
    return this.#said(start, squeeze);
  }

  /** The hand as open, as long as that has to be said first. */
  opened() {
    return this.#said(this.#start, 0);
  }

  #said(start, squeeze) {
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
  /** Called when another arm becomes the active one, or both move in another way. */
  onActive = () => {};
  /** Places of both tools in the world, `{left: [x, y, z], right: …}`, where they are known. */
  tools = {};
  /** How long it takes from a message to the picture that shows what it did. */
  latency = new Latency();
  #virtual = { left: new Hand(), right: new Hand() };
  #mirrored = new Pair(this, true);
  #together = new Pair(this, false);
  #isMirrored = true;
  #mustOpen = true; // until a message has said so: a squeeze counts after a release
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

  /** What mouse, arrow keys and sticks move: "left", "right" or "both". */
  get active() {
    return this.#active;
  }

  set active(side) {
    if (side === this.#active) return;
    this.letGo();
    if (side === "both") this.#mirrored.lead = this.#active;
    this.#active = side;
    this.onActive();
  }

  /** The sides that are moved. */
  get sides() {
    return this.#active === "both" ? ["left", "right"] : [this.#active];
  }

  /** The side of the tool that the pointer leads; also while both are moved. */
  get lead() {
    return this.#active === "both" ? this.#mirrored.lead : this.#active;
  }

  /** The hand of the active side, or what stands for both. */
  get hand() {
    if (this.#active !== "both") return this.#virtual[this.#active];
    return this.#isMirrored ? this.#mirrored : this.#together;
  }

  /** Both hands as if they held one thing. */
  get together() {
    return this.#together;
  }

  /** Where the tool is that the pointer leads; undefined where that is not known. */
  get place() {
    return this.#active === "both" ? this.hand.place : this.tools[this.#active];
  }

  /** Whether both mirror each other, instead of going as one thing. */
  get isMirrored() {
    return this.#isMirrored;
  }

  set isMirrored(value) {
    this.letGo();
    this.#isMirrored = value;
    this.onActive();
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
    this.#mustOpen = true;
  }

  /** Both hands let go and their grippers open, as an episode begins. */
  open() {
    this.left.open();
    this.right.open();
  }

  /** Send a message without a hand in it, such as "keep". */
  say(kind) {
    if (this.#isDriving) this.tell(kind);
  }

  /** The same, also while another drives. */
  tell(kind) {
    this.#socket.send(JSON.stringify({ kind }));
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
    const { left, right } = this.tracked ?? this.#sampled(now);
    const message = { kind: "hands", sent: now, seq: this.#seq++, left, right, devices };
    this.#socket.send(JSON.stringify(message));
    this.latency.sent(now);
  }

  #sampled(now) {
    const { left, right } = this;
    if (!this.#mustOpen) return { left: left.sample(now), right: right.sample(now) };
    this.#mustOpen = false;
    return { left: left.opened(), right: right.opened() };
  }
}
