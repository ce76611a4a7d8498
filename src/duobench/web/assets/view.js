// A canvas with a scene and a camera; draws when there is something else to see.

import { Orbit } from "./orbit.js";
import { Scene } from "./scene.js";

const MOST_PIXELS = 2; // a CSS pixel, along both sides
const SLOW_MS = 70; // an image that takes longer, again and again, gets fewer pixels

/** `scene` is what is seen, `orbit` the camera. */
export class View {
  /** While this is true, something else draws, as a headset does. */
  isCovered = () => false;
  /** Called when an image was drawn. */
  onDraw = () => {};
  /** Called with the graphics before the scene is drawn; says whether there is more to draw. */
  onBegin = () => false;
  #canvas;
  #gl;
  #isAsked = false;
  #density = MOST_PIXELS;
  #slow = 0;

  /** Throws an Error, in words for people, where the browser cannot show 3D. */
  constructor(canvas) {
    this.#canvas = canvas;
    this.scene = new Scene(canvas);
    this.orbit = new Orbit(canvas);
    this.#gl = canvas.getContext("webgl2");
    this.scene.onChange = this.orbit.onChange = () => this.draw();
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  /** Show another scene; the camera stays where it is if it was to begin at the same place. */
  async load(file) {
    const before = JSON.stringify(this.scene.header?.camera);
    await this.scene.load(file);
    const { camera } = this.scene.header;
    if (JSON.stringify(camera) !== before) this.orbit.look(camera);
  }

  /** Draw with the browser's next image. */
  draw() {
    if (this.#isAsked) return;
    this.#isAsked = true;
    requestAnimationFrame((time) => {
      this.#isAsked = false;
      if (this.isCovered()) return;
      const began = performance.now();
      this.#paint();
      this.onDraw();
      this.#adapt(performance.now() - Math.min(began, time));
    });
  }

  #paint() {
    const canvas = this.#canvas;
    const gl = this.#gl;
    const density = Math.min(window.devicePixelRatio || 1, this.#density);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((length) =>
      Math.max(1, Math.round(length * density)),
    );
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
    if (this.onBegin(gl)) this.draw();
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.scene.draw(this.orbit.view, this.orbit.projection, [0, 0, width, height]);
  }

  /** A processor that draws instead of a graphics card gets fewer pixels. */
  #adapt(milliseconds) {
    this.#slow = milliseconds > SLOW_MS ? this.#slow + 1 : 0;
    if (this.#slow < 5) return;
    this.#slow = 0;
    this.#density = Math.max(0.6, 0.8 * Math.min(window.devicePixelRatio || 1, this.#density));
  }
}
