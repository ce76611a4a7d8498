// The connection of a page to its server.

const RETRY_MS = [100, 500, 1000, 2000, 4000]; // until the server is called again
const NAME = "duobench-page"; // in the storage of this tab

/**
 * The name by which the server knows this page again after a cut, and after it was reloaded.
 *
 * It lies in the storage of the tab only between two pages of it: a tab that is doubled copies the
 * storage, and is another page.
 */
function pageName() {
  const store = (act) => {
    try {
      return act(sessionStorage);
    } catch {
      return null; // a browser may keep no storage for a page
    }
  };
  let name = store((storage) => storage.getItem(NAME));
  name ??= [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16)).join("");
  store((storage) => storage.removeItem(NAME));
  addEventListener("pagehide", () => store((storage) => storage.setItem(NAME, name)));
  addEventListener("pageshow", () => store((storage) => storage.removeItem(NAME)));
  return name;
}

/** A connection that is made anew when it is lost; speaks like a WebSocket, events included. */
export class Connection extends EventTarget {
  #socket = null;
  #tries = 0;
  #isEnded = false;

  /** To the server of this page. */
  static home() {
    const url = new URL("/ws", location.href);
    url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    url.search = location.search; // holds the token
    url.searchParams.set("page", pageName());
    return new Connection(url.href);
  }

  constructor(url) {
    super();
    this.#connect(url);
  }

  get bufferedAmount() {
    return this.#socket.bufferedAmount;
  }

  get isOpen() {
    return this.#socket.readyState === WebSocket.OPEN;
  }

  send(text) {
    if (this.isOpen) this.#socket.send(text);
  }

  tell(message) {
    this.send(JSON.stringify(message));
  }

  /** There is nothing more to come: its loss is none. */
  end() {
    this.#isEnded = true;
  }

  #connect(url) {
    const socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    this.#socket = socket;
    socket.addEventListener("open", () => {
      this.#tries = 0;
      this.dispatchEvent(new Event("open"));
    });
    socket.addEventListener("message", ({ data }) =>
      this.dispatchEvent(new MessageEvent("message", { data })),
    );
    socket.addEventListener("close", () => {
      if (this.#isEnded) return;
      this.dispatchEvent(new Event("close"));
      const wait = RETRY_MS[Math.min(this.#tries++, RETRY_MS.length - 1)];
      setTimeout(() => this.#connect(url), wait);
    });
  }
}
