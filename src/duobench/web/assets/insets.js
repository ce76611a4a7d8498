// What the robot's cameras see, drawn in the browser from the scene that is there anyway.

import { make } from "./controls.js";

const [NEAR, FAR] = [0.01, 7]; // metres
const MOST_PIXELS = 1.5; // a CSS pixel, along both sides

/** `v` turned by a quaternion `[w, x, y, z]`. */
function turned([w, x, y, z], [a, b, c]) {
  const [p, q, r] = [y * c - z * b + w * a, z * a - x * c + w * b, x * b - y * a + w * c];
  return [a + 2 * (y * r - z * q), b + 2 * (z * p - x * r), c + 2 * (x * q - y * p)];
}

/** Eye from world and clip from eye, column by column, of a camera of a scene's file. */
function lensOf({ body, pose, fovy, aspect }, poses) {
  const [at, turn] = [pose.slice(0, 3), pose.slice(3)];
  let axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => turned(turn, axis));
  let eye = at;
  if (body) {
    const carrier = [...poses.subarray(7 * (body - 1), 7 * body)];
    const [place, carried] = [carrier.slice(0, 3), carrier.slice(3)];
    axes = axes.map((axis) => turned(carried, axis));
    eye = turned(carried, at).map((value, i) => value + place[i]);
  }
  const shift = axes.map((axis) => -axis.reduce((sum, value, i) => sum + value * eye[i], 0));
  const view = [0, 1, 2].flatMap((i) => [...axes.map((axis) => axis[i]), 0]).concat(shift, 1);
  const tangent = Math.tan((fovy * Math.PI) / 360);
  const depth = 1 / (NEAR - FAR);
  const projection = [
    ...[1 / (tangent * aspect), 0, 0, 0],
    ...[0, 1 / tangent, 0, 0],
    ...[0, 0, (NEAR + FAR) * depth, -1],
    ...[0, 0, 2 * NEAR * FAR * depth, 0],
  ];
  return { view: new Float32Array(view), projection: new Float32Array(projection) };
}

/** One small picture for each camera of the scene, in the place where a rig shows its images. */
export class Insets {
  /** Draws marks into a picture, by its pen, its lens and its size in pixels. */
  mark = () => {};
  #place;
  #tiles = [];
  #active = [];
  #turn = 0;

  constructor(place) {
    this.#place = place;
  }

  /** Have a picture for each of these cameras. */
  build(cameras = []) {
    if (!cameras.length) return;
    this.#tiles = cameras.map((camera) => {
      const title = `${camera.name[0].toUpperCase()}${camera.name.slice(1).replaceAll("_", " ")}`;
      const picture = make("canvas", { class: "picture", role: "img", "aria-label": `${title} camera` });
      const words = make("figcaption", {}, make("b", {}, title));
      const figure = make("figure", { "data-camera": camera.name }, picture, words);
      return { camera, figure, picture, pen: picture.getContext("2d"), when: 0 };
    });
    const items = this.#tiles.map(({ figure }) => make("li", {}, figure));
    this.#place.querySelector("ul").replaceChildren(...items);
    this.#place.hidden = false;
  }

  /** Say which arms are led: their cameras are the bright ones, and drawn most often. */
  set active(sides) {
    this.#active = sides;
    for (const { camera, figure } of this.#tiles) {
      const isOther = camera.body && sides.length && !sides.some((side) => camera.name.startsWith(side));
      figure.dataset.state = isOther ? "other" : "live";
    }
  }

  /**
   * Draw the next one with a scene's graphics, before the scene itself is drawn.
   *
   * One at a time, so that they cost little where no graphics card draws. Returns whether one
   * still shows what was before.
   */
  paint(gl, scene) {
    const poses = scene.poses;
    if (!poses) return false;
    const old = this.#tiles.filter(({ shown }) => shown !== poses);
    if (!old.length) return false;
    const isActive = ({ camera }) => this.#active.some((side) => camera.name.startsWith(side));
    const next = (this.#turn++ % 2 && old.find(isActive)) || old.toSorted((a, b) => a.when - b.when)[0];
    next.shown = poses;
    next.when = this.#turn;
    this.#draw(gl, scene, poses, next);
    return old.length > 1;
  }

  /** The same for a headset: all pictures from left to right, if one was drawn anew or always. */
  pictures(gl, scene, isAlways) {
    const before = this.#turn;
    this.paint(gl, scene);
    const order = ["left_wrist", "head", "right_wrist"];
    const place = ({ camera }) => order.indexOf(camera.name);
    const tiles = this.#tiles.toSorted((one, other) => place(one) - place(other));
    const isNew = isAlways || this.#turn !== before;
    return isNew && tiles.length ? tiles.map(({ picture }) => picture) : null;
  }

  #draw(gl, scene, poses, { camera, picture, pen }) {
    const density = Math.min(window.devicePixelRatio || 1, MOST_PIXELS);
    const width = Math.min(gl.canvas.width, Math.round(picture.clientWidth * density));
    const height = Math.min(gl.canvas.height, Math.round(width / camera.aspect));
    if (width < 8 || height < 8) return;
    if (picture.width !== width) picture.width = width;
    if (picture.height !== height) picture.height = height;
    const { view, projection } = lensOf(camera, poses);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const showsRoom = scene.showsRoom;
    scene.showsRoom = true;
    scene.draw(view, projection, [0, gl.canvas.height - height, width, height]);
    scene.showsRoom = showsRoom;
    pen.drawImage(gl.canvas, 0, 0, width, height, 0, 0, width, height);
    this.mark(pen, view, projection, width, height);
  }
}
