// What right, away and up mean to somebody who looks at the table through a camera.

/**
 * The axes of a view laid level: `right` and `away` along the table, `up` out of it.
 *
 * `orbit` has `right`, `up` and `forward`, directions of the view in the world. Looking straight
 * down, away is what is up in the image.
 */
export function viewAxes({ right, up, forward }) {
  const away = [forward[0] + up[0], forward[1] + up[1]];
  const length = Math.hypot(...away);
  return {
    right: [right[0], right[1], 0],
    away: [away[0] / length, away[1] / length, 0],
    up: [0, 0, 1],
  };
}

/**
 * Turn a hand as a ball under the pointer: rightwards, downwards, and in the plane of the view.
 *
 * Angles in radians; the last one is clockwise.
 */
export function turnInView(hand, { right, up, forward }, across, down = 0, clockwise = 0) {
  if (across) hand.turn(up, across);
  if (down) hand.turn(right, down);
  if (clockwise) hand.turn(forward, clockwise);
}
