/** The socket: speaks first, answers frames, comes back after a loss. */
import { Cell } from "./cell";
import { decode, type Frame } from "./frames";
import { type Failure, PROTOCOL, type Reply, type Request } from "./protocol";

const FIRST_WAIT_MS = 300;
const LONGEST_WAIT_MS = 5000;

/** connecting: never open yet; lost: was open, tries again; unreachable: has tried for a while. */
export type Status = "connecting" | "open" | "lost" | "unreachable";

/** The server's refusal of a message. */
export class Refusal extends Error {
  readonly failure: Failure;

  constructor(failure: Failure) {
    super(`${failure.needed}: ${failure.found}`);
    this.failure = failure;
  }
}

/** The connection went away before the answer came. */
export class Disconnected extends Error {}

interface Waiting {
  resolve: () => void;
  reject: (reason: Error) => void;
}

const TRIES_BEFORE_GIVING_ADVICE = 3;

export class Connection {
  readonly status = new Cell<Status>("connecting");
  readonly #address: string;
  readonly #onReply: (reply: Reply) => void;
  readonly #onFrame: (frame: Frame) => void;
  readonly #waiting = new Map<number, Waiting>();
  #socket: WebSocket | null = null;
  #lastId = 0;
  #failures = 0;
  #timer = 0;

  constructor(address: string, onReply: (reply: Reply) => void, onFrame: (frame: Frame) => void) {
    this.#address = address;
    this.#onReply = onReply;
    this.#onFrame = onFrame;
  }

  open(): void {
    clearTimeout(this.#timer);
    const socket = new WebSocket(this.#address);
    socket.binaryType = "arraybuffer";
    socket.addEventListener("open", () => socket.send(JSON.stringify({ type: "hello", protocol: PROTOCOL })));
    socket.addEventListener("message", (event: MessageEvent<string | ArrayBuffer>) => this.#receive(event.data));
    socket.addEventListener("close", () => this.#closed());
    this.#socket = socket;
  }

  /** Resolves when the server has done it; rejects with a Refusal if it does not. */
  ask(request: Request): Promise<void> {
    this.#lastId += 1;
    const id = this.#lastId;
    return new Promise((resolve, reject) => {
      if (this.status.value !== "open") {
        reject(new Disconnected());
        return;
      }
      this.#waiting.set(id, { resolve, reject });
      this.#socket?.send(JSON.stringify({ ...request, id }));
    });
  }

  /** Says something that needs no answer; nothing happens while there is no connection. */
  tell(request: Request): void {
    if (this.status.value === "open") this.#socket?.send(JSON.stringify(request));
  }

  #receive(data: string | ArrayBuffer): void {
    if (typeof data === "string") this.#answered(JSON.parse(data) as Reply);
    else {
      const frame = decode(data);
      this.#onFrame(frame);
      this.tell({ type: "ack", frame: frame.number });
    }
  }

  #answered(reply: Reply): void {
    if (reply.type === "hello") {
      this.#failures = 0;
      this.status.value = "open";
    }
    const waiting = (reply.type === "done" || reply.type === "error") && reply.id !== null ? this.#waiting.get(reply.id) : undefined;
    if (waiting && (reply.type === "done" || reply.type === "error") && reply.id !== null) {
      this.#waiting.delete(reply.id);
      if (reply.type === "done") waiting.resolve();
      else waiting.reject(new Refusal(reply));
    } else this.#onReply(reply);
  }

  #closed(): void {
    this.#failures += 1;
    for (const { reject } of this.#waiting.values()) reject(new Disconnected());
    this.#waiting.clear();
    this.status.value =
      this.#failures > TRIES_BEFORE_GIVING_ADVICE ? "unreachable" : this.status.value === "connecting" ? "connecting" : "lost";
    this.#timer = window.setTimeout(() => this.open(), Math.min(LONGEST_WAIT_MS, FIRST_WAIT_MS * 2 ** this.#failures));
  }
}
