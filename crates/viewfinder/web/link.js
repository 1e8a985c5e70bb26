// The connection to the camera: commands out, states, numbers and frames in. What is said faster than the screen shows is said once a frame.

const MAGIC = 0x31465644; // "DVF1", little endian

export class Link extends EventTarget {
  constructor() {
    super();
    this.patch = null;
    this.moves = new Map();
    this.probe = null;
    this.asked = false;
    this.wait = 250;
    this.connect();
  }

  connect() {
    const socket = new WebSocket(`ws://${location.host}/ws`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      this.wait = 250;
      this.tell("open");
    };
    socket.onmessage = (event) => {
      if (typeof event.data === "string") {
        const message = JSON.parse(event.data);
        this.tell(message.kind, message);
      } else {
        this.tell("frame", parse(event.data));
      }
    };
    socket.onclose = () => {
      this.tell("lost");
      // Longer and longer, at most every few seconds.
      setTimeout(() => this.connect(), this.wait);
      this.wait = Math.min(4000, this.wait * 2);
    };
  }

  tell(kind, detail) {
    this.dispatchEvent(new CustomEvent(kind, { detail }));
  }

  send(command) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(command));
  }

  // Changes settings of the shot.
  set(patch) {
    this.patch = merged(this.patch ?? {}, patch);
    this.soon();
  }

  move(how, x, y) {
    const [a, b] = this.moves.get(how) ?? [0, 0];
    this.moves.set(how, [a + x, b + y]);
    this.soon();
  }

  ask(at) {
    this.probe = at;
    this.soon();
  }

  soon() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      for (const [how, by] of this.moves) this.send({ do: "move", how, by });
      this.moves.clear();
      if (this.patch) this.send({ do: "set", shot: this.patch });
      this.patch = null;
      if (this.probe) this.send({ do: "probe", at: this.probe });
      this.probe = null;
    });
  }
}

// A merge patch on top of another: null takes a key away, and stays to say so.
function merged(below, above) {
  if (above === null || typeof above !== "object" || Array.isArray(above)) return above;
  const out = below !== null && typeof below === "object" && !Array.isArray(below) ? { ...below } : {};
  for (const [key, value] of Object.entries(above)) out[key] = merged(out[key], value);
  return out;
}

function parse(buffer) {
  const view = new DataView(buffer);
  if (view.getUint32(0, true) !== MAGIC) throw new Error("frame");
  const length = view.getUint32(4, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, length)));
  const size = view.getUint32(8 + length, true);
  const start = 12 + length;
  return {
    header,
    picture: new Blob([new Uint8Array(buffer, start, size)], { type: "image/jpeg" }),
    blur: header.blur ? new Int8Array(buffer.slice(start + size, start + size + header.blur.bytes)) : null,
  };
}
