// Rotations as quaternions (w, x, y, z).

export const IDENTITY = [1, 0, 0, 0];

/** The rotation by an angle about an axis of length one. */
export function quaternion(axis, angle) {
  const sine = Math.sin(angle / 2);
  return [Math.cos(angle / 2), ...axis.map((value) => value * sine)];
}

/** One rotation after another. */
export function multiply([a, b, c, d], [w, x, y, z]) {
  return [
    a * w - b * x - c * y - d * z,
    a * x + b * w + c * z - d * y,
    a * y - b * z + c * w + d * x,
    a * z + b * y - c * x + d * w,
  ];
}

/** A vector, turned. */
export function turned(vector, [w, x, y, z]) {
  const [, ...found] = multiply(multiply([w, x, y, z], [0, ...vector]), [w, -x, -y, -z]);
  return found;
}
