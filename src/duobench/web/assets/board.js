// Boards that stand in the scene, behind the table, for somebody who wears a headset.

const [WIDTH, HEIGHT] = [1024, 448]; // pixels of the text
const PLACE = { x: 1.25, halfWidth: 0.36, low: 0.45, high: 0.765 }; // in the world, in m
/** Place and pixels of a board above that one, for three pictures. */
export const ABOVE = {
  place: { x: 1.25, halfWidth: 0.54, low: 0.775, high: 0.9775 },
  size: [1536, 288],
};
const MARGIN = 32;
const SIZES = { first: 54, others: 40 }; // of letters, where there is room for them
const SMALLER = 0.94;
const LEADING = 1.25; // of a row, as a multiple of its letters
const DEPTH = 0.3; // of letters below their line
const INK = "#e8e6e1";
const PAPER = "#1b1f23";

const VERTEX = `#version 300 es
in vec3 place;
in vec2 pixel;
uniform mat4 view;
uniform mat4 projection;
out vec2 at;
void main() { at = pixel; gl_Position = projection * view * vec4(place, 1.0); }`;
const FRAGMENT = `#version 300 es
precision mediump float;
in vec2 at;
uniform sampler2D text;
out vec4 colour;
void main() { colour = texture(text, at); }`;

/** A context of WebGL2, and lines of text in it, or pictures. */
export class Board {
  #gl;
  #program;
  #corners;
  #texture;
  #paper;
  #shown = null;
  /** Rows of the text, `{row, size, font, y}`: what is written how large, and on which line. */
  rows = [];

  constructor(gl, { place = PLACE, size = [WIDTH, HEIGHT] } = {}) {
    this.#gl = gl;
    this.#paper = new OffscreenCanvas(...size);
    this.#program = this.#link();
    this.#corners = this.#build(place);
    this.#texture = gl.createTexture();
    this.show([]);
  }

  /** What is on it. */
  get paper() {
    return this.#paper;
  }

  /** Write lines on the board, the first in large letters, so large that all of them fit. */
  show(lines) {
    const text = lines.join("\n");
    if (text === this.#shown) return;
    this.#shown = text;
    const pen = this.#paper.getContext("2d", { willReadFrequently: true });
    pen.fillStyle = PAPER;
    pen.fillRect(0, 0, WIDTH, HEIGHT);
    pen.fillStyle = INK;
    this.rows = fitted(pen, lines);
    for (const { font, row, y } of this.rows) {
      pen.font = font;
      pen.fillText(row, MARGIN, y);
    }
    this.#upload();
  }

  /** Hang pictures side by side on the board in place of lines. */
  hang(pictures) {
    const { width, height } = this.#paper;
    const pen = this.#paper.getContext("2d");
    const room = width / pictures.length;
    pictures.forEach((picture, number) => pen.drawImage(picture, number * room, 0, room, height));
    this.#upload();
  }

  #upload() {
    const gl = this.#gl;
    gl.bindTexture(gl.TEXTURE_2D, this.#texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, this.#paper);
    gl.generateMipmap(gl.TEXTURE_2D);
  }

  /** Draw it for one eye, after the scene, by what `Scene.draw` takes. */
  draw(view, projection, port) {
    const gl = this.#gl;
    gl.viewport(...port);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.#program);
    gl.bindVertexArray(this.#corners);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.#texture);
    gl.uniformMatrix4fv(gl.getUniformLocation(this.#program, "view"), false, view);
    gl.uniformMatrix4fv(gl.getUniformLocation(this.#program, "projection"), false, projection);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.bindVertexArray(null);
  }

  #link() {
    const gl = this.#gl;
    const program = gl.createProgram();
    for (const [type, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    return program;
  }

  #build({ x, halfWidth: half, low, high }) {
    const gl = this.#gl;
    const corners = [
      ...[x, half, low, 0, 1],
      ...[x, -half, low, 1, 1],
      ...[x, half, high, 0, 0],
      ...[x, -half, high, 1, 0],
    ];
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(corners), gl.STATIC_DRAW);
    for (const [name, size, offset] of [["place", 3, 0], ["pixel", 2, 12]]) {
      const at = gl.getAttribLocation(this.#program, name);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, size, gl.FLOAT, false, 20, offset);
    }
    gl.bindVertexArray(null);
    return array;
  }
}

/** Lines in rows of the largest letters with which all of them are on the board. */
function fitted(pen, lines) {
  for (let scale = 1; ; scale *= SMALLER) {
    const rows = laidOut(pen, lines, scale);
    const last = rows.at(-1);
    if (!last || last.y + DEPTH * last.size <= HEIGHT - MARGIN) return rows;
  }
}

function laidOut(pen, lines, scale) {
  let y = MARGIN / 2 - 4;
  return lines.flatMap((line, number) => {
    const size = scale * (number ? SIZES.others : SIZES.first);
    const font = `${number ? "" : "600 "}${size}px system-ui, sans-serif`;
    pen.font = font;
    return wrapped(pen, line).map((row) => ({ row, size, font, y: (y += LEADING * size) }));
  });
}

function wrapped(pen, line) {
  const fits = (text) => pen.measureText(text).width <= WIDTH - 2 * MARGIN;
  const rows = [""];
  for (const word of line.split(/\s+/).flatMap((word) => broken(word, fits))) {
    const longer = rows.at(-1) ? `${rows.at(-1)} ${word}` : word;
    if (fits(longer)) rows[rows.length - 1] = longer;
    else rows.push(word);
  }
  return rows;
}

/** A word in parts that fit into a row. */
function broken(word, fits) {
  if (fits(word)) return [word];
  const parts = [""];
  for (const letter of word) {
    if (fits(parts.at(-1) + letter)) parts[parts.length - 1] += letter;
    else parts.push(letter);
  }
  return parts;
}
