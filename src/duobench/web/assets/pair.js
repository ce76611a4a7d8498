// Both hands under one pointer.

import { quaternion, turned } from "./turning.js";

const SIDES = ["left", "right"];

/**
 * Stands for both hands where a single one is moved.
 *
 * Mirrored, one does what the other does, seen in a mirror between the arms (the plane y = 0).
 * Otherwise both go as one thing that they hold: alike, and a turn goes about the middle between
 * the tools.
 */
export class Pair {
  /** The side that does as the pointer does; the other one mirrors it. */
  lead = "right";
  #hands;
  #isMirrored;
  #arms = null; // from the middle between the tools to each, while both are held

  /** `hands` has `left`, `right`, and the places of the tools as `tools`. */
  constructor(hands, isMirrored) {
    this.#hands = hands;
    this.#isMirrored = isMirrored;
  }

  /** Where the pointer is measured: at the tool that leads, or between both. */
  get place() {
    const { tools } = this.#hands;
    return this.#isMirrored ? tools[this.lead] : this.#middle;
  }

  hold(device, until) {
    if (!this.#both.some((hand) => hand.isHeld)) this.#arms = this.#measured;
    for (const hand of this.#both) hand.hold(device, until);
  }

  release(device) {
    for (const hand of this.#both) hand.release(device);
  }

  isHeldBy(device) {
    return this.#both.every((hand) => hand.isHeldBy(device));
  }

  /** Move by a displacement in metres along the axes of the world. */
  move(shift) {
    const [x, y, z] = shift;
    for (const side of SIDES) this.#hands[side].move(this.#mirrors(side) ? [x, -y, z] : shift);
  }

  /** Turn by an angle about an axis of length one, given in the world. */
  turn(axis, angle) {
    const [x, y, z] = axis;
    for (const side of SIDES) {
      this.#hands[side].turn(this.#mirrors(side) ? [-x, y, -z] : axis, angle);
    }
    if (!this.#isMirrored) this.#swing(quaternion(axis, angle));
  }

  #swing(rotation) {
    for (const side of SIDES) {
      const arm = this.#arms?.[side];
      if (!arm) continue;
      this.#arms[side] = turned(arm, rotation);
      this.#hands[side].move(this.#arms[side].map((value, i) => value - arm[i]));
    }
  }

  #mirrors(side) {
    return this.#isMirrored && side !== this.lead;
  }

  get #both() {
    return SIDES.map((side) => this.#hands[side]);
  }

  get #middle() {
    const { left, right } = this.#hands.tools;
    return left && right && left.map((value, i) => (value + right[i]) / 2);
  }

  get #measured() {
    const middle = this.#middle;
    if (!middle) return null;
    const { tools } = this.#hands;
    return Object.fromEntries(
      SIDES.map((side) => [side, tools[side].map((value, i) => value - middle[i])]),
    );
  }
}
