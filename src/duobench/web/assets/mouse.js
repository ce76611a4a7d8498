// Mouse and keys: a drag is a hand that is squeezed while the button is down.

import { turnInView, viewAxes } from "./directions.js";

const TABLE = [0.45, 0, 0.1]; // what a pixel is measured at while no tool's place is known
const LEAST_DEPTH = 0.1; // metres, of a tool right before the camera or behind it
const RADIANS_A_PIXEL = 0.005;
const WHEEL = 0.0002; // metres a pixel of the wheel: 2 cm a notch
const WHEEL_TURN = 0.0005; // radians a pixel of the wheel: 0.05 a notch
const WHEEL_MS = 450; // how long a turn of the wheel keeps the hand squeezed
const STEP = { move: 0.005, turn: 0.05 }; // a tap of a key, in m and rad
const SPEED = { move: 0.15, turn: 0.8 }; // a key held down, in m/s and rad/s
const TAP_MS = 300; // what is pressed for longer is held
const FOLLOW_MS = 450; // how long the hand stays squeezed, so that the tool goes all of a tap's way
const FINE = 0.25; // of all this, while its key is held
const OPENING = 0.25; // of a gripper, a step
const NEXT = { right: "left", left: "both", both: "right" };

/** What a key is called here: letters are small, whether Shift is held or not. */
function nameOf({ key }) {
  return key.length === 1 ? key.toLowerCase() : key;
}

/** Moves the active hand by mouse and keys, on an element that shows what `orbit` sees. */
export class Mouse {
  /** What a key does, by the key: the name of an act of `#acts`, and what it is given. */
  keys = new Map();
  #element;
  #orbit;
  #hands;
  #drag = null;
  #keys = new Map(); // steering key held down → when it was pressed
  #grippers = new Map(); // gripper's key held down → when it was pressed
  #share = 1; // of every motion
  #acts;

  constructor({ element, orbit, hands }) {
    this.#element = element;
    this.#orbit = orbit;
    this.#hands = hands;
    this.#acts = {
      leave: () => element.blur(),
      lead: (side) => (hands.active = side),
      next: () => (hands.active = NEXT[hands.active]),
      mirror: () => (hands.isMirrored = !hands.isMirrored),
      fine: () => (this.#share = FINE),
      say: (word) => hands.say(word),
      grip: (side, event, key) => this.#grip(side, event, key),
      steer: (way, event, key) => this.#steer(key, event.shiftKey),
    };
    // Captured, so that a camera on the same element gets only what is left over.
    const listen = (target, type, method) =>
      target.addEventListener(
        type,
        (event) => {
          if (!hands.isDriving || !method.call(this, event)) return;
          event.preventDefault();
          event.stopImmediatePropagation();
        },
        { capture: true, passive: false },
      );
    listen(element, "pointerdown", this.#press);
    listen(element, "pointermove", this.#move);
    listen(element, "pointerup", this.#release);
    listen(element, "pointercancel", this.#release);
    listen(element, "wheel", this.#wheel);
    listen(element, "dblclick", () => true);
    listen(window, "keydown", this.#keydown);
    listen(window, "keyup", this.#keyup);
    addEventListener("blur", () => (this.#share = 1));
  }

  /** Go on moving for the keys that are held down. */
  update(seconds, now) {
    const hand = this.#hands.hand;
    for (const [key, since] of this.#keys) {
      if (!hand.isHeldBy(key)) this.#keys.delete(key);
      else if (now - since > TAP_MS) this.#step(key, SPEED, seconds);
    }
  }

  /** Metres in the plane of the view, at the depth of the active tool, that a pixel shows. */
  get #metresAPixel() {
    const [x, y, z] = this.#hands.place ?? TABLE;
    const view = this.#orbit.view;
    const depth = -(view[2] * x + view[6] * y + view[10] * z + view[14]);
    return (2 * Math.max(depth, LEAST_DEPTH)) / (this.#orbit.projection[5] * this.#element.clientHeight);
  }

  #press(event) {
    this.#element.focus({ preventScroll: true });
    if (event.pointerType !== "mouse" || event.button !== 0) return false;
    this.#element.setPointerCapture(event.pointerId);
    this.#drag = { x: event.clientX, y: event.clientY, scale: this.#metresAPixel };
    this.#hands.hand.hold("mouse");
    return true;
  }

  #move(event) {
    const drag = this.#drag;
    const hand = this.#hands.hand;
    if (!drag || !hand.isHeldBy("mouse")) return false;
    const across = (event.clientX - drag.x) * this.#share;
    const down = (event.clientY - drag.y) * this.#share;
    Object.assign(drag, { x: event.clientX, y: event.clientY });
    const { right, up, forward } = this.#orbit;
    if (event.shiftKey) {
      turnInView(hand, this.#orbit, across * RADIANS_A_PIXEL, down * RADIANS_A_PIXEL);
    } else if (event.ctrlKey) {
      hand.move(forward.map((value) => -value * down * drag.scale));
    } else {
      hand.move(right.map((value, i) => (value * across - up[i] * down) * drag.scale));
    }
    return true;
  }

  #release() {
    if (!this.#drag) return false;
    this.#drag = null;
    this.#hands.hand.release("mouse");
    return true;
  }

  #wheel(event) {
    if (event.ctrlKey) return false; // the camera's: also what a pinch on a touchpad gives
    if (document.activeElement !== this.#element) return false; // scrolls the page
    const hand = this.#hands.hand;
    const turned = event.deltaY || event.deltaX; // many browsers scroll sideways with Shift
    const pixels = turned * (event.deltaMode ? 33 : 1) * this.#share; // from lines
    hand.hold("wheel", performance.now() + WHEEL_MS);
    if (event.shiftKey) turnInView(hand, this.#orbit, 0, 0, pixels * WHEEL_TURN);
    else hand.move(this.#orbit.forward.map((value) => -value * pixels * WHEEL));
    return true;
  }

  #keydown(event) {
    if (!this.#isMine(event)) return false;
    const key = nameOf(event);
    const [act, value] = this.keys.get(key) ?? [];
    if (!act) return false;
    const isWayOut = event.shiftKey || event.target !== this.#element;
    if (act === "next" && isWayOut) return false;
    if (!event.repeat) this.#acts[act](value, event, key);
    return true;
  }

  #keyup(event) {
    const key = nameOf(event);
    const [act, value] = this.keys.get(key) ?? [];
    if (act === "fine") this.#share = 1;
    const pressed = this.#keys.get(key);
    const { hand } = this.#hands;
    if (this.#keys.delete(key) && hand.isHeldBy(key)) hand.hold(key, pressed + FOLLOW_MS);
    const since = this.#grippers.get(key);
    this.#grippers.delete(key);
    if (since !== undefined && performance.now() - since > TAP_MS) this.#toggle(value);
    return false;
  }

  /** Whether a key is meant for the arms: it is where nothing else on the page is in focus. */
  #isMine(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return false;
    return event.target === this.#element || event.target === document.body;
  }

  /** A tap closes or opens; with Shift it opens by a step, with the fine key it closes by one. */
  #grip(side, event, key) {
    const hand = this.#hands[side];
    if (event.shiftKey) hand.squeezeBy("keys", -OPENING);
    else if (this.#share < 1) hand.squeezeBy("keys", OPENING);
    else {
      this.#toggle(side);
      this.#grippers.set(key, performance.now());
    }
  }

  #toggle(side) {
    const hand = this.#hands[side];
    hand.press("keys", hand.trigger > 0.5 ? 0 : 1);
  }

  #steer(key, isTurning) {
    this.#hands.hand.hold(key);
    this.#keys.set(key, performance.now());
    this.#isTurning = isTurning;
    this.#step(key, STEP, 1);
  }

  #isTurning = false;

  #step(key, amount, times) {
    const [axis, direction] = this.keys.get(key)[1];
    const sign = direction * this.#share;
    const hand = this.#hands.hand;
    const angle = sign * amount.turn * times;
    if (axis === "upright") {
      hand.turn([0, 0, 1], angle);
    } else if (this.#isTurning) {
      const turns = { right: [angle, 0, 0], away: [0, -angle, 0], up: [0, 0, angle] };
      turnInView(hand, this.#orbit, ...turns[axis]);
    } else {
      const axes = viewAxes(this.#orbit);
      hand.move(axes[axis].map((value) => value * sign * amount.move * times));
    }
  }
}
