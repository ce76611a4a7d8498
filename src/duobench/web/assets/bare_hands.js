// A tracked hand without a controller: its fingers are grip and trigger.

const HOLDING = ["middle-finger", "ring-finger", "pinky-finger"];
// Distance of the tip from the wrist, as a multiple of that of the finger's first joint.
const STRAIGHT = 1.6;
const CURLED = 1.1;
// Between the tips of thumb and index finger, in metres.
const APART = 0.07;
const TOUCHING = 0.02;
const NO_BUTTONS = { keep: false, discard: false, restore: false, recentre: false };

/**
 * What a hand does, as a controller says it: `{pose, squeeze, trigger, buttons}`.
 *
 * Middle, ring and little finger close around a handle that is not there: that is the grip. Thumb
 * and index finger are the two fingers of the gripper. Null where a joint is not seen.
 */
export function gestureOf(frame, hand, space) {
  const poses = new Map();
  for (const name of joints()) {
    const joint = hand.get(name);
    const pose = joint && frame.getJointPose(joint, space);
    if (!pose) return null;
    poses.set(name, pose);
  }
  const apart = (one, other) => distance(poses.get(one), poses.get(other));
  const reach = HOLDING.map((finger) => apart("wrist", `${finger}-tip`) / apart("wrist", first(finger)));
  const pose = poses.get("wrist");
  return {
    pose,
    squeeze: share(Math.max(...reach), STRAIGHT, CURLED),
    trigger: share(apart("thumb-tip", "index-finger-tip"), APART, TOUCHING),
    buttons: NO_BUTTONS,
  };
}

function joints() {
  const holding = HOLDING.flatMap((finger) => [`${finger}-tip`, first(finger)]);
  return ["wrist", "thumb-tip", "index-finger-tip", ...holding];
}

const first = (finger) => `${finger}-phalanx-proximal`;

function distance({ transform: { position: a } }, { transform: { position: b } }) {
  return Math.hypot(a.x - b.x, a.y - b.y, a.z - b.z);
}

/** 0 at the one end, 1 at the other. */
function share(value, none, full) {
  return Math.min(1, Math.max(0, (none - value) / (none - full)));
}
