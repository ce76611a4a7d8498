// A model in WebGL2: its triangles once, then a pose of each moving body; one draw call an eye.

import { DEPTH_FRAGMENT, DEPTH_VERTEX, FRAGMENT, VERTEX } from "./shaders.js";

const SHADOW_TEXELS = 1024; // side of the shadow map
const SHADOW_DEPTH = 3; // metres along the light on both sides of the middle
const DOWN = [0, 0, -1];
const LIGHTS = 4; // as many as the shader knows
const PLANES = [
  // attribute, numbers, bytes a vertex
  ["position", 3, 12],
  ["normal", 4, 4],
  ["colour", 4, 4],
  ["body", 1, 4],
];

/** A scene file, opened: `{header, planes, corners}`; its format stands in web/geometry.py. */
export async function readScene(file) {
  const opened = new Blob([file]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = await new Response(opened).arrayBuffer();
  const length = new DataView(bytes).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
  let start = 4 + length;
  const planes = PLANES.map(([, , size]) => {
    const plane = new Uint8Array(bytes, start, size * header.vertices);
    start += plane.byteLength;
    return plane;
  });
  const corners = new Uint32Array(bytes.slice(start));
  for (let i = 1; i < corners.length; i++) corners[i] += corners[i - 1];
  return { header, planes, corners };
}

/** What a canvas shows of a model. */
export class Scene {
  /** Whether room, floor and legs of the table are drawn; without them one sees the real ones. */
  showsRoom = true;
  /** What the scene file says: camera, lights, number of bodies; null before one is loaded. */
  header = null;
  /** Called when there is something else to see, after a loss of the graphics too. */
  onChange = () => {};
  #gl;
  #content = null;
  #loads = 0;
  #poses = null;
  #given = null;
  #isFromAbove = false;
  #programs;
  #array;
  #buffers = [];
  #block;
  #shadow;
  #isShadowOld = true;

  /** Throws an Error, in words for people, where the browser has no WebGL2. */
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: true });
    if (!gl) throw new Error("This browser cannot show 3D: it has no WebGL 2.");
    this.#gl = gl;
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.#prepare();
      if (this.#content) this.#upload();
      this.onChange();
    });
    this.#prepare();
  }

  /** Show another scene file from now on, in the place where it was compiled. */
  async load(file) {
    const load = ++this.#loads;
    const content = await readScene(file);
    if (load !== this.#loads) return; // another one was asked for meanwhile
    this.#content = content;
    this.header = content.header;
    this.#poses = this.#given = null;
    this.#upload();
    this.onChange();
  }

  /**
   * Put the bodies where they are: seven numbers each, x y z and w x y z.
   *
   * Returns whether that is another picture than before.
   */
  setPoses(poses) {
    if (!this.header || poses.length !== 7 * this.header.bodies) return false;
    if (this.#given?.every((value, i) => value === poses[i])) return false;
    const block = new Float32Array(8 * (this.header.bodies + 1));
    block.set([0, 0, 0, 0, 0, 0, 0, 1]); // the world
    for (let body = 0; body < this.header.bodies; body++) {
      const [x, y, z, w, i, j, k] = poses.subarray(7 * body, 7 * body + 7);
      block.set([x, y, z, 0, i, j, k, w], 8 * (body + 1));
    }
    this.#poses = block;
    this.#given = poses;
    this.#place();
    this.onChange();
    return true;
  }

  /** The poses as they were given last; null before that. */
  get poses() {
    return this.#given;
  }

  /** Have shadows fall straight down, whatever the light's place: below each tool lies its own. */
  set isLitFromAbove(isSo) {
    if (isSo === this.#isFromAbove) return;
    this.#isFromAbove = isSo;
    if (!this.#content) return;
    this.#light();
    this.#isShadowOld = true;
    this.onChange();
  }

  /**
   * Draw for one eye, into a part of what is bound as framebuffer, which the caller has cleared.
   *
   * `view` and `projection` are column by column, `port` is [x, y, width, height] in pixels.
   */
  draw(view, projection, port) {
    if (!this.#poses || this.#gl.isContextLost()) return;
    const gl = this.#gl;
    if (this.#isShadowOld) this.#castShadows();
    gl.viewport(...port);
    this.#begin();
    gl.bindVertexArray(this.#array);
    const { program, places } = this.#programs.scene;
    gl.useProgram(program);
    gl.uniformMatrix4fv(places.view, false, view);
    gl.uniformMatrix4fv(places.projection, false, projection);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.#shadow.texture);
    gl.bindBufferBase(gl.UNIFORM_BUFFER, 0, this.#block);
    const { corners, layers } = this.header;
    const first = this.showsRoom ? 0 : layers[0];
    gl.drawElements(gl.TRIANGLES, corners - first, gl.UNSIGNED_INT, 4 * first);
    this.#end();
  }

  #prepare() {
    const gl = this.#gl;
    this.#programs = {
      scene: link(gl, VERTEX, FRAGMENT),
      depth: link(gl, DEPTH_VERTEX, DEPTH_FRAGMENT),
    };
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW_TEXELS, SHADOW_TEXELS);
    const settings = {
      [gl.TEXTURE_COMPARE_MODE]: gl.COMPARE_REF_TO_TEXTURE,
      [gl.TEXTURE_MIN_FILTER]: gl.LINEAR,
      [gl.TEXTURE_MAG_FILTER]: gl.LINEAR,
      [gl.TEXTURE_WRAP_S]: gl.CLAMP_TO_EDGE,
      [gl.TEXTURE_WRAP_T]: gl.CLAMP_TO_EDGE,
    };
    for (const [name, value] of Object.entries(settings)) {
      gl.texParameteri(gl.TEXTURE_2D, Number(name), value);
    }
    const frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, texture, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.#shadow = { texture, frame };
    this.#array = gl.createVertexArray();
    this.#buffers = [];
    this.#block = gl.createBuffer();
  }

  #upload() {
    const gl = this.#gl;
    const { planes, corners } = this.#content;
    this.#buffers.forEach((buffer) => gl.deleteBuffer(buffer));
    gl.bindVertexArray(this.#array);
    this.#buffers = planes.map((plane, place) => {
      const buffer = gl.createBuffer();
      const [name, count, size] = PLANES[place];
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, plane, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      if (name === "body") gl.vertexAttribIPointer(place, count, gl.UNSIGNED_INT, size, 0);
      else {
        const type = { position: gl.FLOAT, normal: gl.BYTE, colour: gl.UNSIGNED_BYTE }[name];
        gl.vertexAttribPointer(place, count, type, name === "colour", size, 0);
      }
      return buffer;
    });
    const indices = gl.createBuffer();
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, indices);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
    this.#buffers.push(indices);
    gl.bindVertexArray(null);
    this.#light();
    this.#place();
  }

  /** Set what is the same in every image of this scene. */
  #light() {
    const gl = this.#gl;
    const { ambient, shadow } = this.header;
    const lights = this.header.lights.map((each) =>
      each.shadow && this.#isFromAbove ? { ...each, direction: DOWN } : each,
    );
    const light = lights.find((each) => each.shadow);
    const shine = light ? lightMatrix(light.direction, shadow) : new Float32Array(16);
    const known = lights.slice(0, LIGHTS);
    for (const { program, places } of Object.values(this.#programs)) {
      gl.useProgram(program);
      gl.uniformMatrix4fv(places.light, false, shine);
      gl.uniformBlockBinding(program, gl.getUniformBlockIndex(program, "Bodies"), 0);
    }
    const { program, places } = this.#programs.scene;
    const rows = (each, width) => {
      const flat = new Float32Array(width * LIGHTS);
      known.forEach((one, i) => flat.set([each(one)].flat(), width * i));
      return flat;
    };
    gl.useProgram(program);
    gl.uniform3fv(places.ambient, ambient);
    gl.uniform3fv(places["direction[0]"], rows((one) => one.direction, 3));
    gl.uniform3fv(places["shine[0]"], rows((one) => one.colour, 3));
    gl.uniform1fv(places["gloss[0]"], rows((one) => one.highlight, 1));
    gl.uniform1i(places.shadowed, known.indexOf(light));
    gl.uniform1i(places.map, 0);
    gl.uniform1f(places.texel, (2 * shadow.reach) / SHADOW_TEXELS);
  }

  #place() {
    if (!this.#poses) return;
    const gl = this.#gl;
    gl.bindBuffer(gl.UNIFORM_BUFFER, this.#block);
    // As large as the shader's block, whatever the number of bodies.
    gl.bufferData(gl.UNIFORM_BUFFER, 8 * 4 * 256, gl.DYNAMIC_DRAW);
    gl.bufferSubData(gl.UNIFORM_BUFFER, 0, this.#poses);
    this.#isShadowOld = true;
  }

  /** Draw what casts shadows as the light sees it; keeps the framebuffer that is bound. */
  #castShadows() {
    const gl = this.#gl;
    const bound = gl.getParameter(gl.FRAMEBUFFER_BINDING);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.#shadow.frame);
    gl.viewport(0, 0, SHADOW_TEXELS, SHADOW_TEXELS);
    this.#begin();
    gl.clear(gl.DEPTH_BUFFER_BIT);
    const { corners, layers } = this.header;
    const first = layers[0] + layers[1];
    gl.bindVertexArray(this.#array);
    gl.useProgram(this.#programs.depth.program);
    gl.bindBufferBase(gl.UNIFORM_BUFFER, 0, this.#block);
    if (this.header.lights.some((light) => light.shadow)) {
      gl.drawElements(gl.TRIANGLES, corners - first, gl.UNSIGNED_INT, 4 * first);
    }
    this.#end();
    gl.bindFramebuffer(gl.FRAMEBUFFER, bound);
    this.#isShadowOld = false;
  }

  #begin() {
    const gl = this.#gl;
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  #end() {
    const gl = this.#gl;
    gl.bindVertexArray(null);
    gl.disable(gl.CULL_FACE);
  }
}

/** Clip from world, column by column, for a light that shines along a direction. */
function lightMatrix(direction, { centre, reach }) {
  const side = normalized(cross(direction, Math.abs(direction[1]) > 0.9 ? [1, 0, 0] : [0, 1, 0]));
  const up = cross(side, direction);
  const rows = [
    [side, 1 / reach],
    [up, 1 / reach],
    [direction, 1 / SHADOW_DEPTH],
  ].map(([axis, scale]) => [...axis.map((value) => value * scale), -dot(axis, centre) * scale]);
  return new Float32Array([0, 1, 2, 3].flatMap((i) => [...rows.map((row) => row[i]), i === 3]));
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

function normalized(a) {
  return a.map((value) => value / Math.hypot(...a));
}

/** A program and the places of its uniforms, by name. */
function link(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [type, source] of [
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  PLANES.forEach(([name], place) => gl.bindAttribLocation(program, place, name));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(`This browser cannot show 3D: ${gl.getProgramInfoLog(program)}`);
  }
  const places = {};
  const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
  for (let i = 0; i < count; i++) {
    const { name } = gl.getActiveUniform(program, i);
    places[name] = gl.getUniformLocation(program, name);
  }
  return { program, places };
}
