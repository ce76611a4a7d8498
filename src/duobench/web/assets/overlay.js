// What lies over the live image while objects are placed; the browser blends it.

const SVG = "http://www.w3.org/2000/svg";
const FLICKER_MS = 500; // slower than three flashes a second

/** The live image, and over it the layout, the robot's ghost and outlines. */
export class Overlay {
  #page;
  #isFlickered = false;
  #outlines = "";

  constructor(page) {
    this.#page = page;
    for (const name of ["opacity", "flicker", "difference", "show-outlines", "show-ghost"]) {
      this.#part(name).addEventListener("input", () => this.#blend());
    }
    this.#part("native").addEventListener("input", () => {
      page.querySelector(".stack").classList.toggle("native", this.#part("native").checked);
    });
    setInterval(() => {
      this.#isFlickered = this.#part("flicker").checked && !this.#isFlickered;
      this.#blend();
    }, FLICKER_MS);
    this.#blend();
  }

  /** Draw a frame of the camera, JPEG. */
  async draw(data) {
    const canvas = this.#part("live");
    const image = await createImageBitmap(new Blob([data], { type: "image/jpeg" }));
    canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
    canvas.dataset.frames = Number(canvas.dataset.frames ?? 0) + 1;
    image.close();
  }

  /** Show images by their addresses, and outlines in pixels of the camera. */
  show({ images, footprints, image_size: size, isPlacing }) {
    for (const name of ["layout", "ghost"]) {
      const image = this.#part(name);
      const address = images[name];
      if (address && image.getAttribute("src") !== address) image.src = address;
      image.dataset.isThere = address && isPlacing ? "yes" : "";
    }
    const text = JSON.stringify([footprints, isPlacing]);
    if (text !== this.#outlines) this.#draw(text, isPlacing ? footprints : [], size);
    this.#blend();
  }

  #draw(text, footprints, [width, height]) {
    this.#outlines = text;
    const svg = this.#part("outlines");
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const shapes = footprints.flatMap(({ number, outlines }) => {
      const drawn = outlines.filter((outline) => outline.length > 2);
      if (!drawn.length) return [];
      const lines = drawn.flatMap((outline) => {
        const points = outline.map((point) => point.join(",")).join(" ");
        return ["halo", ""].map((name) => shape("polygon", { points, class: name }));
      });
      const corners = drawn.flat();
      const [x, y] = [0, 1].map((axis) => mean(corners.map((point) => point[axis])));
      const label = shape("text", { x, y });
      label.textContent = number;
      return [...lines, label];
    });
    svg.replaceChildren(...shapes);
  }

  #blend() {
    const layout = this.#part("layout");
    const isDifference = this.#part("difference").checked;
    layout.style.mixBlendMode = isDifference ? "difference" : "normal";
    layout.style.opacity = isDifference ? 1 : this.#part("opacity").value / 100;
    layout.hidden = !layout.dataset.isThere || this.#isFlickered;
    const ghost = this.#part("ghost");
    ghost.hidden = !ghost.dataset.isThere || !this.#part("show-ghost").checked;
    this.#part("outlines").style.visibility = this.#part("show-outlines").checked
      ? "visible"
      : "hidden";
  }

  #part(name) {
    return this.#page.querySelector(`#${name}`);
  }
}

function shape(name, attributes) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}

function mean(numbers) {
  return numbers.reduce((sum, number) => sum + number, 0) / numbers.length;
}
