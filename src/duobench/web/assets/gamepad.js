// A gamepad of the standard mapping: sticks move the active hand, triggers close the grippers.

import { turnInView, viewAxes } from "./directions.js";

const SPEED = 0.25; // m/s, of a stick pushed to its end
const TURN = 1.0; // rad/s
const DEAD = 0.15; // what a stick at rest may show
const BUTTON = {
  ...{ turn: 0, left: 4, right: 5, leftTrigger: 6, rightTrigger: 7, restore: 3, discard: 8, keep: 9 },
};

const pushed = (value) => {
  const size = Math.min(1, Math.max(0, (Math.abs(value) - DEAD) / (1 - DEAD)));
  return Math.sign(value) * size;
};

/** The first gamepad of the standard mapping, asked again before each message. */
export class Gamepads {
  #orbit;
  #hands;
  #was = [];

  constructor({ orbit, hands }) {
    this.#orbit = orbit;
    this.#hands = hands;
  }

  update(seconds) {
    const hands = this.#hands;
    const pad = this.#pad;
    if (!pad) {
      for (const hand of [hands.left, hands.right]) hand.release("gamepad");
      return;
    }
    const was = this.#was;
    this.#was = pad.buttons.map((button) => button.pressed);
    const isNew = (name) => pad.buttons[BUTTON[name]]?.pressed && !was[BUTTON[name]];
    for (const side of ["left", "right"]) {
      if (isNew(side)) hands.active = side;
      hands[side].press("gamepad", pad.buttons[BUTTON[`${side}Trigger`]]?.value ?? 0);
    }
    for (const word of ["keep", "discard", "restore"]) if (isNew(word)) hands.say(word);
    this.#steer(pad, seconds);
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

  #steer(pad, seconds) {
    const hand = this.#hands.hand;
    const [across, down, turned, lowered] = [0, 1, 2, 3].map((axis) => pushed(pad.axes[axis]));
    if (!(across || down || turned || lowered)) {
      hand.release("gamepad");
      return;
    }
    hand.hold("gamepad");
    if (pad.buttons[BUTTON.turn].pressed) {
      const angle = TURN * seconds;
      turnInView(hand, this.#orbit, across * angle, down * angle, turned * angle);
      return;
    }
    const { right, away } = viewAxes(this.#orbit);
    const step = SPEED * seconds;
    hand.move([0, 1].map((i) => (right[i] * across - away[i] * down) * step).concat(-lowered * step));
    if (turned) hand.turn([0, 0, 1], -turned * TURN * seconds);
  }
}
