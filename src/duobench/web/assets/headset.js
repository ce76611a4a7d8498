// A headset: its controllers are the hands, and its eyes see the scene, in VR or on a real table.

import { gestureOf } from "./bare_hands.js";
import { ABOVE, Board } from "./board.js";

const HEAD = [0.0113, 0.001, 0.695]; // where the robot's head camera is, in the world, in m
const TABLE_HEIGHT = 0.8095; // of the table top above the floor, in m
const LIFT = 0.1; // m/s, of a real table's height by a stick
const LEAST_TURN = 0.05; // metres to point away before that turns the table
const PRESSED = 0.5;
const RELEASED = 0.3; // a grip, before it may squeeze again
const ASKED_MS = 1000; // how long something is held that asks for something
const SIDES = ["left", "right"];
const BUTTON = { trigger: 0, squeeze: 1, stick: 3, keep: 4, other: 5 }; // mapping xr-standard
const PLACING = [
  "Place the table",
  "Point at where the robot stands on it and press the trigger.",
  "Point where the robot looks to, and let go.",
  "Stick up and down: the height of your table.",
];

/** Whether a page may have a headset: `{vr, ar, reason}`, a reason where it has neither. */
export async function support() {
  if (!navigator.xr) {
    const reason = isSecureContext
      ? "This browser knows no headsets (it has no WebXR)."
      : `No headset: browsers give WebXR only to pages that come over https or from the machine
        itself, and this one came over plain http from ${location.hostname}. Connect the headset by
        cable, or ask for a server with a certificate.`;
    return { vr: false, ar: false, reason };
  }
  const has = (mode) => navigator.xr.isSessionSupported(mode).catch(() => false);
  const [vr, ar] = await Promise.all([has("immersive-vr"), has("immersive-ar")]);
  return { vr, ar, reason: vr || ar ? null : "No headset is connected to this browser." };
}

/** The direction in which a pose of WebXR looks, and its up, in the axes of its space. */
function directions({ orientation: { x, y, z, w } }) {
  const forward = [-2 * (x * z + w * y), 2 * (w * x - y * z), 2 * (x * x + y * y) - 1];
  const up = [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)];
  return { forward, up };
}

/** Angle about the room's vertical at which a pose looks ahead, wherever it looks up or down. */
function headingOf(transform) {
  const { forward, up } = directions(transform);
  const [x, z] = [0, 2].map((i) => forward[i] - forward[1] * up[i]);
  return Math.atan2(-x, -z);
}

/** Pose of the world in a room of WebXR (y up): x of the world along a heading, z up. */
function worldInRoom([x, y, z], heading) {
  const [c, s] = [Math.cos(heading / 2) / 2, Math.sin(heading / 2) / 2];
  const orientation = { x: s - c, y: c + s, z: c + s, w: c - s };
  return new XRRigidTransform({ x, y, z }, orientation);
}

/** Something that counts once it was held long enough, after it was seen released. */
class LongPress {
  #isArmed = false;
  #what = null;
  #since = 0;

  /** Held so far, as a share of the time that it takes. */
  share = 0;

  /** What is held now, or null: returns it once, when it was held long enough. */
  update(what, now) {
    if (what !== this.#what) this.#since = now;
    this.#what = what;
    if (what === null) this.#isArmed = true;
    const isHeld = what !== null && this.#isArmed;
    this.share = isHeld ? Math.min(1, (now - this.#since) / ASKED_MS) : 0;
    if (this.share < 1) return null;
    this.forget();
    return what;
  }

  /** It must be released first. */
  forget() {
    this.#isArmed = false;
    this.share = 0;
  }
}

/** One session at a time, in which `hands.tracked` are the controllers. */
export class Headset {
  /** Called when a session has begun or ended. */
  onChange = () => {};
  /**
   * Called with the graphics, and whether pictures are wanted in any case; gives small ones for a
   * board of their own, or null where none is new.
   */
  pictures = () => null;
  /** Gives what the board in the scene says, by what is held and whether hands are bare. */
  words = () => [];
  /** Called with what a person asks for by holding on: "drive", "keep" or "discard". */
  onAsk = () => {};
  /** State of the episode, as the server says it. */
  state = null;
  #gl;
  #scene;
  #hands;
  #board;
  #gallery = null; // a board with pictures, once there are any
  #session = null;
  #isSeeThrough = false;
  #room = null; // where the person is
  #world = null; // the same, measured in the frame of the table
  #placing = null; // in AR: {height, origin or null, heading, side that points}
  #isUnsettled = true; // until the viewer was put where the robot's head is
  #mustRelease = { left: true, right: true };
  #clicked = { left: false, right: false };
  #mustOpen = { left: false, right: false }; // a trigger, before its gripper follows it again
  #isBare = false; // whether hands without controllers are tracked
  #isHolding = false; // both sticks are clicked
  #asked = new LongPress();
  #moment = ""; // in which something may be asked for
  #time = 0;

  constructor({ canvas, scene, hands }) {
    this.#gl = canvas.getContext("webgl2");
    this.#scene = scene;
    this.#hands = hands;
    canvas.addEventListener("webglcontextrestored", () => (this.#board = this.#gallery = null));
  }

  /** What the board in the scene says; the first line is the largest. */
  get lines() {
    return this.words({ asked: this.#asked.share, isBare: this.#isBare });
  }

  get isWorn() {
    return this.#session !== null;
  }

  /** Begin a session, "immersive-vr" or "immersive-ar"; only a click of the user may ask for it. */
  async enter(mode) {
    this.#isSeeThrough = mode === "immersive-ar";
    const space = this.#isSeeThrough ? "local-floor" : "local";
    const session = await navigator.xr.requestSession(mode, {
      requiredFeatures: [space],
      optionalFeatures: ["hand-tracking"],
    });
    this.#session = session;
    session.addEventListener("end", () => this.#ended());
    try {
      await this.#begin(session, space);
    } catch (error) {
      session.end();
      throw error;
    }
    this.onChange();
  }

  async #begin(session, space) {
    this.#scene.showsRoom = !this.#isSeeThrough;
    await this.#gl.makeXRCompatible();
    const baseLayer = new XRWebGLLayer(session, this.#gl);
    session.updateRenderState({ baseLayer, depthNear: 0.05, depthFar: 20 });
    this.#room = await session.requestReferenceSpace(space);
    this.#room.addEventListener("reset", () => this.#unsettle());
    this.#unsettle();
    session.requestAnimationFrame((time, frame) => this.#frame(time, frame));
  }

  leave() {
    return this.#session?.end();
  }

  /** Let the controller of a side rumble. */
  pulse(side, strength, milliseconds) {
    for (const { handedness, gamepad } of this.#session?.inputSources ?? []) {
      if (handedness === side) gamepad?.hapticActuators?.[0]?.pulse(strength, milliseconds);
    }
  }

  #ended() {
    this.#session = null;
    this.#hands.tracked = null;
    this.#hands.letGo();
    this.#scene.showsRoom = true;
    this.#gl.bindFramebuffer(this.#gl.FRAMEBUFFER, null);
    this.#scene.onChange();
    this.onChange();
  }

  /** Put the viewer or the table anew; no hand moves anything until it was opened again. */
  #unsettle() {
    this.#isUnsettled = true;
    this.#mustRelease = { left: true, right: true };
    const placing = { height: TABLE_HEIGHT, origin: null, heading: 0, side: null };
    this.#placing = this.#isSeeThrough ? placing : null;
  }

  #frame(time, frame) {
    const session = frame.session;
    session.requestAnimationFrame((next, later) => this.#frame(next, later));
    const seconds = Math.min(0.1, (time - this.#time) / 1000);
    this.#time = time;
    const viewer = frame.getViewerPose(this.#room);
    if (!viewer) {
      this.#hands.tracked = { left: null, right: null };
      this.#hands.tick();
      return;
    }
    if (this.#placing) this.#placeTable(frame, viewer, seconds);
    else if (this.#isUnsettled) this.#placeViewer(viewer);
    const hands = this.#read(frame);
    this.#ask(hands, time);
    this.#hands.tracked = hands;
    this.#hands.tick();
    this.#draw(frame);
  }

  #settle(position, heading) {
    this.#world = this.#room.getOffsetReferenceSpace(worldInRoom(position, heading));
  }

  /** Put the viewer's eyes where the robot's head camera is, the robot's forward ahead. */
  #placeViewer({ transform }) {
    const heading = headingOf(transform);
    const [c, s] = [Math.cos(heading), Math.sin(heading)];
    const { x, y, z } = transform.position;
    const [ahead, left, high] = HEAD;
    this.#settle([x + s * ahead + c * left, y - high, z + c * ahead - s * left], heading);
    this.#isUnsettled = false;
  }

  /** Let the table hang on the pointing ray until a trigger was pressed and released. */
  #placeTable(frame, viewer, seconds) {
    const placing = this.#placing;
    const sources = [...frame.session.inputSources].filter((source) => source.gamepad);
    const value = (source) => source.gamepad.buttons[BUTTON.trigger]?.value ?? 0;
    const points = placing.origin
      ? (source) => source.handedness === placing.side
      : (source) => value(source) > PRESSED;
    const source = sources.find(points) ?? (placing.origin ? null : sources.at(-1));
    const pose = source && frame.getPose(source.targetRaySpace, this.#room);
    if (!pose) {
      if (!placing.origin) this.#settle([0, placing.height, -0.5], headingOf(viewer.transform));
      return;
    }
    const lift = source.gamepad.axes[3] ?? 0;
    if (Math.abs(lift) > 0.2) placing.height -= lift * LIFT * seconds;
    const [x, z] = this.#pointed(pose.transform, placing.height);
    const isPressed = value(source) > PRESSED;
    if (!placing.origin) placing.heading = headingOf(viewer.transform);
    if (isPressed && !placing.origin) {
      Object.assign(placing, { origin: [x, z], side: source.handedness });
    }
    const origin = placing.origin ?? [x, z];
    const away = [x - origin[0], z - origin[1]];
    if (Math.hypot(...away) > LEAST_TURN) placing.heading = Math.atan2(-away[0], -away[1]);
    this.#settle([origin[0], placing.height, origin[1]], placing.heading);
    if (placing.origin && !isPressed) {
      this.#placing = null;
      this.#isUnsettled = false;
    }
  }

  /** Where a ray meets a level plane, (x, z) in the room; two metres ahead where it does not. */
  #pointed(transform, height) {
    const { position } = transform;
    const { forward } = directions(transform);
    const along = (height - position.y) / forward[1];
    const reach = along > 0 && along < 2 ? along : 2;
    return [position.x + forward[0] * reach, position.z + forward[2] * reach];
  }

  #read(frame) {
    const hands = { left: null, right: null };
    const clicked = { left: false, right: false };
    this.#isBare = false;
    if (frame.session.visibilityState !== "visible" || this.#isUnsettled) return hands;
    for (const source of frame.session.inputSources) {
      const side = source.handedness;
      if (!(side in hands)) continue;
      if (source.hand) {
        const found = gestureOf(frame, source.hand, this.#world);
        this.#isBare ||= found !== null;
        hands[side] ??= found && this.#hand(side, found.pose, found);
      } else if (source.gripSpace && source.gamepad) {
        const pose = frame.getPose(source.gripSpace, this.#world);
        const pressed = this.#pressed(side, source.gamepad.buttons);
        clicked[side] = pressed.buttons.recentre;
        if (pose) hands[side] = this.#hand(side, pose, pressed);
      }
    }
    this.#click(clicked);
    return hands;
  }

  #pressed(side, buttons) {
    const isPressed = (name) => buttons[BUTTON[name]]?.pressed ?? false;
    return {
      squeeze: buttons[BUTTON.squeeze]?.value ?? 0,
      trigger: buttons[BUTTON.trigger]?.value ?? 0,
      buttons: {
        keep: isPressed("keep"),
        discard: side === "right" && isPressed("other"),
        restore: side === "left" && isPressed("other"),
        recentre: isPressed("stick"),
      },
    };
  }

  /** A click of a stick puts the view anew; that of both holds the arms. */
  #click(clicked) {
    const isNew = SIDES.some((side) => clicked[side] && !this.#clicked[side]);
    if (isNew) this.#unsettle();
    this.#clicked = clicked;
    const isHolding = clicked.left && clicked.right;
    if (isHolding && !this.#isHolding) this.#hands.tell("hold");
    this.#isHolding = isHolding;
  }

  #hand(side, { transform, emulatedPosition }, { squeeze, trigger, buttons }) {
    if (squeeze < RELEASED) this.#mustRelease[side] = false;
    if (trigger < RELEASED) this.#mustOpen[side] = false;
    const { position, orientation } = transform;
    return {
      pose: [...[position.x, position.y, position.z], orientation.w]
        .concat([orientation.x, orientation.y, orientation.z]),
      sure: !emulatedPosition,
      squeeze: this.#mustRelease[side] ? 0 : squeeze,
      trigger: this.#mustOpen[side] ? 0 : trigger,
      buttons,
    };
  }

  /** Look whether a trigger, or a pinch, was held for so long that it asks for something. */
  #ask(hands, now) {
    const { isDriving } = this.#hands;
    const moment = `${isDriving} ${this.state}`;
    if (moment !== this.#moment) this.#asked.forget();
    this.#moment = moment;
    const held = SIDES.filter((side) => hands[side]?.trigger > PRESSED);
    const judged = this.#isBare && this.state === "decide" && held.length === 1;
    const what = judged && (held[0] === "right" ? "keep" : "discard");
    const asked = isDriving ? what || null : held.length ? "drive" : null;
    const found = this.#asked.update(asked, now);
    if (!found) return;
    this.#mustOpen = { left: true, right: true };
    this.onAsk(found);
  }

  #draw(frame) {
    const gl = this.#gl;
    if (gl.isContextLost()) return;
    const layer = frame.session.renderState.baseLayer;
    const pose = frame.getViewerPose(this.#world);
    this.#board ??= new Board(gl);
    this.#board.show(this.#placing ? PLACING : this.lines);
    const pictures = this.pictures(gl, !this.#gallery);
    if (pictures) (this.#gallery ??= new Board(gl, ABOVE)).hang(pictures);
    gl.bindFramebuffer(gl.FRAMEBUFFER, layer.framebuffer);
    gl.clearColor(...(this.#isSeeThrough ? [0, 0, 0, 0] : [0.85, 0.87, 0.89, 1]));
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    for (const eye of pose?.views ?? []) {
      const { x, y, width, height } = layer.getViewport(eye);
      const view = eye.transform.inverse.matrix;
      this.#scene.draw(view, eye.projectionMatrix, [x, y, width, height]);
      this.#board.draw(view, eye.projectionMatrix, [x, y, width, height]);
      this.#gallery?.draw(view, eye.projectionMatrix, [x, y, width, height]);
    }
    this.#hands.latency.drawn((call) => frame.session.requestAnimationFrame(call));
  }
}
