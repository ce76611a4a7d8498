// What is said to who drives beside what the session says: on the board of a headset, on the page.

const HINTS = {
  waiting: "Hold a grip: its arm follows your hand. The trigger closes the gripper.",
  decide: "A or X keeps the episode, B discards it.",
};
const BARE = {
  waiting: `Close middle, ring and little finger: the arm follows your hand. Thumb and index finger
    are the gripper.`,
  decide: "Pinch for 1 s: right hand keeps the episode, left hand discards it.",
};
const LOST = "Connection lost: the arms stand still. Trying again …";
const BACK = "Connected again, and you drive. Open your hands, then hold again.";
const TAKEN = "Connected again, but somebody else drives now.";
const FREE = "Connected again, and nobody drives.";
const STEPS = 5; // of what is held down

const isSaid = (value) => value !== undefined && value !== null;

/** Remembers what the server said, and puts it in words. */
export class Words {
  status = {};
  #role = null;
  #link = null; // null, "lost", "back" until something is led again

  set role(role) {
    this.#role = role;
    if (this.#link === "lost") this.#link = "back";
  }

  /** The connection is lost. */
  cut() {
    this.#link = "lost";
    this.#role = null;
    this.status = { ...this.status, clutch: null };
  }

  /** Whether another one drives. */
  get isTaken() {
    return this.#role?.role !== "driver" && this.#role?.drivers > 0;
  }

  /** What the page says beside the note of the session. */
  onPage() {
    const { state, clutch } = this.status;
    if (this.#link && this.#isDriving && (clutch?.left || clutch?.right)) this.#link = null;
    if (this.#link) return this.#said;
    if (!this.#isDriving) return "";
    if (state === "waiting") return "Drag a tool, press an arrow key or push a stick of a gamepad.";
    return "";
  }

  /**
   * The lines of the board, the most important one first.
   *
   * `asked` is the share, 0 to 1, of a trigger's hold that asks for something, `isBare` whether
   * hands without controllers are tracked, `ms` the time from hand to picture.
   */
  onBoard({ asked = 0, isBare = false, ms = null } = {}) {
    const { instruction, next, note, state, discarded, panel } = this.status;
    const hints = isBare ? BARE : HINTS;
    const lines = [
      this.#link && this.#said,
      !this.#isDriving && this.#link !== "lost" && this.#way(isBare),
      asked > 0 && bar(asked),
      instruction,
      panel?.todo ?? note,
      next && `Next: ${next}`,
      this.#facts(ms),
      this.#isDriving && hints[state],
      this.#isDriving && discarded > 0 && !isBare && `${discarded} discarded; Y asks about the last one.`,
    ];
    return lines.filter(Boolean);
  }

  get #isDriving() {
    return this.#role?.role === "driver";
  }

  get #said() {
    if (this.#link === "lost") return LOST;
    if (this.#isDriving) return BACK;
    return this.isTaken ? TAKEN : FREE;
  }

  #way(isBare) {
    const how = isBare ? "Pinch for 1 s" : "Hold a trigger for 1 s";
    return this.isTaken
      ? `You watch, somebody else drives. ${how} to take over.`
      : `You do not drive yet. ${how} to drive.`;
  }

  #facts(ms) {
    const { stage, max_stage: last, state, pace, led_s: led, kept, wanted, panel } = this.status;
    const step = panel && Math.min(panel.now + 1, panel.steps.length);
    const facts = [
      step && `${step} of ${panel.steps.length}: ${panel.steps[step - 1]}`,
      isSaid(stage) && isSaid(last) && `stage ${stage} of ${last}`,
      pace === "standing" ? "stands still" : state,
      isSaid(led) && `led ${Math.round(led)} s`,
      isSaid(kept) && (isSaid(wanted) ? `${kept} of ${wanted} kept` : `${kept} kept`),
      isSaid(ms) && `hand to picture ${Math.round(ms)} ms`,
    ];
    return facts.filter(Boolean).join(" · ");
  }
}

/** How far something was held down, as a row of signs. */
function bar(share) {
  const full = Math.floor(share * STEPS);
  return "■".repeat(full) + "□".repeat(STEPS - full);
}
