// The WebSocket: requests with answers, pictures, and messages of the server.

const HALF = new Float32Array(65536);
for (let i = 0; i < 65536; i++) {
  const exponent = (i >> 10) & 31, fraction = i & 1023, sign = i & 0x8000 ? -1 : 1;
  HALF[i] = sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -14 * (fraction / 1024));
}

// A message has a head, a JPEG and a tail. Depths are half floats.
export function unpack(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const begin = 4 + size;
  const jpeg = head.jpeg ? new Blob([new Uint8Array(buffer, begin, head.jpeg)], { type: "image/jpeg" }) : null;
  const tail = buffer.slice(begin + head.jpeg);
  if (head.grid) head.depth = Float32Array.from(new Uint16Array(tail), (half) => HALF[half]);
  return { head, jpeg, tail };
}

// Runs jobs, which return promises, in order and no more than `most` at a time. An urgent one overtakes those that wait.
export function queueOf(most) {
  const waiting = [];
  let running = 0;
  const next = () => {
    for (; running < most && waiting.length; running++) waiting.shift()().finally(() => (running--, next()));
  };
  return (job, urgent = false) => new Promise((yes, no) => {
    waiting[urgent ? "unshift" : "push"](() => Promise.resolve().then(job).then(yes, no));
    next();
  });
}

// Saves by name. What the page has neither loaded nor saved before is replaced only when it is asked for again.
export function saver(link, what) {
  let own = "";
  return {
    loaded: (name) => (own = name),
    save: (name, data) => {
      const fresh = name !== own;
      own = name;
      return link.ask("save", { what, name, data, fresh });
    },
  };
}

const REFUSED = 1008; // the code of a close by the server's rules
// Why a server that can be reached did not take the connection; "": it cannot be reached.
async function refusal() {
  const status = await fetch("icon.svg", { method: "HEAD", signal: AbortSignal.timeout(5000) }).then((answer) => answer.status, () => 0);
  if (status === 401) return "The server was started again, with a new token. Open the address that it printed.";
  return status !== 200 ? "" : "The server does not take this page's connection; trying again. A proxy between them has to pass on " +
    "WebSockets, with the headers Host and Origin of the browser.";
}

export class Link extends EventTarget {
  constructor() {
    super();
    this.waiting = new Map();
    this.next = 1;
    this.open();
  }

  open() {
    const url = new URL("socket", location.href); // beside the page: a proxy may serve it below a path
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(url, "conurb");
    let opened = false;
    socket.binaryType = "arraybuffer";
    socket.onopen = () => (opened = true, this.say("open"));
    socket.onmessage = (event) => this.take(event.data);
    socket.onclose = async ({ code, reason }) => {
      for (const { no } of this.waiting.values()) no(new Error("the connection to the server was lost"));
      this.waiting.clear();
      this.say("closed", code === REFUSED ? `The server says: ${reason}; trying again.` : opened ? "" : await refusal());
      setTimeout(() => this.open(), 1000);
    };
    this.socket = socket;
  }

  say(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }

  take(data) {
    const message = typeof data === "string" ? { head: JSON.parse(data) } : unpack(data);
    const { type, id } = message.head;
    const waiting = this.waiting.get(id);
    if (type === "frame" && !waiting) return this.say("frame", message);
    if (waiting) {
      this.waiting.delete(id);
      return type === "failed" ? waiting.no(new Error(message.head.text)) : waiting.yes(message);
    }
    this.say(type, message.head);
  }

  // Returns the number of the request, which the answer repeats; 0 without a connection.
  send(type, fields = {}) {
    if (this.socket.readyState !== WebSocket.OPEN) return 0;
    const id = this.next++;
    this.socket.send(JSON.stringify({ type, id, ...fields }));
    return id;
  }

  // A file, as a binary message: the length of a head, the head, the file. It is answered only when it is refused.
  upload(type, fields, bytes) {
    return new Promise((yes, no) => {
      if (this.socket.readyState !== WebSocket.OPEN) return no(new Error("there is no connection to the server"));
      const id = this.next++, head = new TextEncoder().encode(JSON.stringify({ type, id, ...fields }));
      const size = new DataView(new ArrayBuffer(4));
      size.setUint32(0, head.length, true);
      this.waiting.set(id, { yes, no });
      this.socket.send(new Blob([size, head, bytes]));
    });
  }

  ask(type, fields) {
    return new Promise((yes, no) => {
      const id = this.send(type, fields);
      if (id) this.waiting.set(id, { yes, no });
      else no(new Error("there is no connection to the server"));
    });
  }
}
