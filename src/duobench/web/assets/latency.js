// From a hand to the picture that shows what it did, by this page's own clock.

const REMEMBERED = 1200; // messages: twenty seconds, far longer than a hand is followed
const LATEST = 30; // measurements, of which the middle one is said

/** Knows when messages were sent, is told which one a picture shows, and when that is seen. */
export class Latency {
  #sent = new Set();
  #arrived = null; // when the message was sent that the picture shows which is drawn next
  #times = [];

  /** The middle one of the last measurements in ms; null before the first. */
  get ms() {
    const sorted = this.#times.toSorted((a, b) => a - b);
    return sorted.length ? sorted[sorted.length >> 1] : null;
  }

  /** A message was sent, at a time in ms. */
  sent(time) {
    this.#sent.add(time);
    if (this.#sent.size > REMEMBERED) this.#sent.delete(this.#sent.values().next().value);
  }

  /** A picture came that shows the message of a time; one of another page, or told before, is none. */
  arrived(time) {
    if (this.#sent.delete(time)) this.#arrived = time;
  }

  /** It is being drawn; `next` takes what is called with the image after it, when it is seen. */
  drawn(next) {
    const time = this.#arrived;
    if (time === null) return;
    this.#arrived = null;
    next(() => {
      this.#times = [...this.#times, performance.now() - time].slice(-LATEST);
    });
  }

  /** Another begins to drive. */
  forget() {
    this.#sent.clear();
    this.#arrived = null;
    this.#times = [];
  }
}
