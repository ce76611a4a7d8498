// A gamepad of the standard mapping: sticks move the active hand, triggers close the grippers.

import { turnInView, viewAxes } from "./directions.js";

const SPEED = 0.25; // m/s, of a stick pushed to its end
const TURN = 1.0; // rad/s
const DEAD = 0.15; // what a stick at rest may show
const BUTTON = {
  turn: 0,
  together: 1,
  restore: 3,
  left: 4,
  right: 5,
  leftTrigger: 6,
  rightTrigger: 7,
  discard: 8,
  keep: 9,
};
const SIDES = ["left", "right"];
const STICK = { left: [0, 1], right: [2, 3] }; // its axes

const pushed = (value) => {
  const size = Math.min(1, Math.max(0, (Math.abs(value) - DEAD) / (1 - DEAD)));
  return Math.sign(value) * size;
};

/** The first gamepad of the standard mapping, asked again before each message. */
export class Gamepads {
  #orbit;
  #hands;
  #was = [];
  #led = new Set(); // hands that it holds
  #mustRest = false; // since it was made to let go

  constructor({ orbit, hands }) {
    this.#orbit = orbit;
    this.#hands = hands;
  }

  update(seconds) {
    const hands = this.#hands;
    const pad = this.#pad;
    if (!pad) {
      this.#lead([]);
      this.#mustRest = true;
      return;
    }
    const was = this.#was;
    this.#was = pad.buttons.map((button) => button.pressed);
    const isPressed = (name) => pad.buttons[BUTTON[name]]?.pressed ?? false;
    const isNew = (name) => isPressed(name) && !was[BUTTON[name]];
    for (const side of SIDES) {
      if (isNew(side)) hands.active = SIDES.every(isPressed) ? "both" : side;
      hands[side].press("gamepad", pad.buttons[BUTTON[`${side}Trigger`]]?.value ?? 0);
    }
    for (const word of ["keep", "discard", "restore"]) if (isNew(word)) hands.say(word);
    this.#steer(pad.axes.slice(0, 4).map(pushed), isPressed, seconds);
  }

  /** Shake the gamepad, where it can. */
  pulse(strength, milliseconds) {
    const motor = this.#pad?.vibrationActuator;
    const effect = { duration: milliseconds, weakMagnitude: strength, strongMagnitude: strength };
    motor?.playEffect("dual-rumble", effect).catch(() => {}); // not every motor has it
  }

  get #pad() {
    return [...navigator.getGamepads()].find((pad) => pad?.mapping === "standard");
  }

  #steer(axes, isPressed, seconds) {
    const hands = this.#hands;
    const isTurning = isPressed("turn");
    const isApart = hands.active === "both" && !isPressed("together");
    const hand = hands.active === "both" ? hands.together : hands.hand;
    const steps = isApart
      ? SIDES.map((side) => [hands[side], STICK[side].map((axis) => axes[axis])])
      : [[hand, axes]];
    const pushes = steps.filter(([, values]) => values.some((value) => value));
    if (!this.#lead(pushes.map(([hand]) => hand))) return;
    for (const [hand, values] of pushes) {
      if (isApart) this.#moveOne(hand, values, isTurning, seconds);
      else if (isTurning) this.#turn(hand, values, seconds);
      else this.#move(hand, values, seconds);
    }
  }

  /**
   * Hold these hands and no others.
   *
   * Where something made it let go, such as a lost connection, its sticks must rest before it holds
   * again. Returns whether it may.
   */
  #lead(hands) {
    this.#mustRest ||= [...this.#led].some((hand) => !hand.isHeldBy("gamepad"));
    if (!hands.length) this.#mustRest = false;
    const held = this.#mustRest ? [] : hands;
    for (const hand of this.#led) if (!held.includes(hand)) hand.release("gamepad");
    for (const hand of held) hand.hold("gamepad");
    this.#led = new Set(held);
    return held.length > 0;
  }

  /** Both sticks lead one hand, or both as one thing. */
  #move(hand, [across, down, turned, lowered], seconds) {
    this.#slide(hand, across, down, seconds);
    if (lowered) hand.move([0, 0, -lowered * SPEED * seconds]);
    if (turned) hand.turn([0, 0, 1], -turned * TURN * seconds);
  }

  #turn(hand, [across, down, turned], seconds) {
    const angle = TURN * seconds;
    turnInView(hand, this.#orbit, across * angle, down * angle, turned * angle);
  }

  /** One stick leads its own hand: along the table, or up and about the vertical. */
  #moveOne(hand, [across, down], isLifting, seconds) {
    if (isLifting) this.#move(hand, [0, 0, across, down], seconds);
    else this.#slide(hand, across, down, seconds);
  }

  #slide(hand, across, down, seconds) {
    const { right, away } = viewAxes(this.#orbit);
    const step = SPEED * seconds;
    hand.move(right.map((value, i) => (value * across - away[i] * down) * step));
  }
}
