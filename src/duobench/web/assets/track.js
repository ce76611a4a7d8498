// The track of an episode: poses of its bodies after each control step; see web/track.py.

const POSITION = 1e-4; // metres
const QUATERNION = 1 / 20480;
const HEAD = 12; // bytes before what is compressed

/** Poses of an episode, at any time between its steps. */
export class Track {
  #series;

  /** `series` holds the numbers of all bodies, seven each, and of each number all steps. */
  constructor(steps, bodies, series) {
    this.steps = steps;
    this.bodies = bodies;
    this.#series = series;
  }

  /** Open the bytes of a track. */
  static async read(file) {
    const head = new DataView(file.buffer, file.byteOffset, HEAD);
    const [steps, bodies] = [head.getUint32(4, true), head.getUint32(8, true)];
    const packed = new Blob([file.subarray(HEAD)]).stream();
    const opened = packed.pipeThrough(new DecompressionStream("deflate-raw"));
    const bytes = new Uint8Array(await new Response(opened).arrayBuffer());
    const count = bytes.length / 2;
    const series = new Int16Array(count); // which counts modulo 2^16
    for (let i = 0; i < count; i++) {
      const difference = bytes[i] | (bytes[count + i] << 8);
      series[i] = i % steps ? series[i - 1] + difference : difference;
    }
    return new Track(steps, bodies, series);
  }

  /** Poses, seven numbers a body, at a step or between two of them. */
  at(step) {
    const last = this.steps - 1;
    const first = Math.max(0, Math.min(last, Math.floor(step)));
    const next = Math.min(last, first + 1);
    const share = Math.max(0, Math.min(1, step - first));
    const poses = new Float32Array(7 * this.bodies);
    for (let i = 0; i < poses.length; i++) {
      const start = i * this.steps;
      const value = this.#series[start + first];
      const scale = i % 7 < 3 ? POSITION : QUATERNION;
      poses[i] = scale * (value + share * (this.#series[start + next] - value));
    }
    for (let i = 3; i < poses.length; i += 7) {
      const length = Math.hypot(...poses.subarray(i, i + 4)) || 1;
      for (let k = i; k < i + 4; k++) poses[k] /= length;
    }
    return poses;
  }
}
