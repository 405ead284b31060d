// The WebSocket to the server: it acknowledges every message and reconnects as long as the page is open.

const AGAIN_MS = 500;

export class Link {
  constructor({ cycle, words, state }) {
    this.handlers = { cycle, words, state };
    this.waiting = new Map();
    this.number = 0;
    this.open();
  }

  open() {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    socket.onopen = () => this.handlers.state(true);
    socket.onmessage = ({ data }) => {
      socket.send("got");
      if (typeof data !== "string") this.handlers.cycle(data);
      else this.take(JSON.parse(data));
    };
    socket.onclose = () => {
      this.handlers.state(false);
      for (const reject of this.waiting.values()) reject({ ok: false, said: { text: "the connection was lost" } });
      this.waiting.clear();
      setTimeout(() => this.open(), AGAIN_MS);
    };
  }

  take(words) {
    if (words.kind !== "reply") return this.handlers.words(words);
    this.waiting.get(words.number)?.(words);
    this.waiting.delete(words.number);
  }

  // The reply to a request: {ok, said}.
  ask(what) {
    if (this.socket.readyState !== WebSocket.OPEN) {
      return Promise.resolve({ ok: false, said: { text: "not connected" } });
    }
    const number = ++this.number;
    this.socket.send(JSON.stringify({ ...what, number }));
    return new Promise((resolve) => this.waiting.set(number, resolve));
  }
}
