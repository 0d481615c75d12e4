/** The page's copy of the session: what the server last said, and how to ask it for more. */
import { Cell } from "./cell";
import { Connection, Disconnected, Refusal } from "./connection";
import type { Frame } from "./frames";
import type { Failure, Hello, MeshSlot, Numbers, Reply, Request, State } from "./protocol";

type Kind = Frame["kind"];
type FrameOf<K extends Kind> = Extract<Frame, { kind: K }>;

export class Session {
  readonly hello = new Cell<Hello | null>(null);
  readonly state = new Cell<State | null>(null);
  readonly numbers = new Cell<Numbers | null>(null);
  /** What the server is busy with. */
  readonly job = new Cell<State["job"]>(null);
  /** How many bytes of an upload are sent, from 0 to 1. */
  readonly upload = new Cell<number | null>(null);
  /** How many questions wait for their answers. */
  readonly waiting = new Cell(0);
  readonly connection: Connection;
  readonly #token: string;
  readonly #listeners = new Map<Kind, ((frame: never) => void)[]>();
  #onFailure: (failure: Failure) => void = () => undefined;
  readonly #jobListeners: ((kind: string, status: string) => void)[] = [];

  constructor(location: Location) {
    this.#token = new URLSearchParams(location.search).get("token") ?? "";
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const address = `${scheme}://${location.host}/socket?token=${encodeURIComponent(this.#token)}`;
    this.connection = new Connection(
      address,
      (reply) => this.#take(reply),
      (frame) => this.#spread(frame),
    );
  }

  onFrame<K extends Kind>(kind: K, listener: (frame: FrameOf<K>) => void): void {
    const listeners = this.#listeners.get(kind) ?? [];
    listeners.push(listener as (frame: never) => void);
    this.#listeners.set(kind, listeners);
  }

  onFailure(listener: (failure: Failure) => void): void {
    this.#onFailure = listener;
  }

  onJob(listener: (kind: string, status: string) => void): void {
    this.#jobListeners.push(listener);
  }

  /** Asks, and tells the person if it was refused; whether it was done. */
  async ask(request: Request): Promise<boolean> {
    this.waiting.value += 1;
    try {
      await this.connection.ask(request);
      return true;
    } catch (error) {
      if (error instanceof Refusal) this.#onFailure(error.failure);
      else if (!(error instanceof Disconnected)) throw error;
      return false;
    } finally {
      this.waiting.value -= 1;
    }
  }

  tell(request: Request): void {
    this.connection.tell(request);
  }

  /** Gives the server a file. */
  send(slot: MeshSlot | "pairs" | "session", file: File): Promise<boolean> {
    const request = new XMLHttpRequest();
    request.open("POST", `/upload?slot=${slot}&name=${encodeURIComponent(file.name)}`);
    request.setRequestHeader("X-Morphlet-Token", this.#token);
    request.upload.addEventListener("progress", (event) => (this.upload.value = event.lengthComputable ? event.loaded / event.total : 0));
    return new Promise((resolve) => {
      request.addEventListener("loadend", () => {
        this.upload.value = null;
        this.waiting.value -= 1;
        if (request.status !== 200) this.#onFailure(refused(request.status, request.responseText));
        resolve(request.status === 200);
      });
      this.upload.value = 0;
      this.waiting.value += 1;
      request.send(file);
    });
  }

  /** Fetches a file of the session; null if there is none. */
  async fetch(what: string): Promise<Blob | null> {
    try {
      const answer = await fetch(`/save/${what}`, { headers: { "X-Morphlet-Token": this.#token } });
      if (answer.ok) return await answer.blob();
      this.#onFailure(refused(answer.status, await answer.text()));
    } catch {
      this.#onFailure(refused(0, ""));
    }
    return null;
  }

  #take(reply: Reply): void {
    if (reply.type === "hello") this.hello.value = reply;
    else if (reply.type === "state") {
      this.state.value = reply;
      this.numbers.value = reply.numbers;
      this.job.value = reply.job;
    } else if (reply.type === "numbers") {
      if (reply.slot === "source") this.numbers.value = reply;
    } else if (reply.type === "error") this.#onFailure(reply);
    else if (reply.type === "job") {
      if (reply.error) this.#onFailure(reply.error);
      for (const listener of this.#jobListeners) listener(reply.kind, reply.status);
    } else if (reply.type === "progress") this.job.value = reply;
  }

  #spread(frame: Frame): void {
    for (const listener of this.#listeners.get(frame.kind) ?? []) (listener as (frame: Frame) => void)(frame);
  }
}

function refused(status: number, body: string): Failure {
  try {
    return { code: "file", ...(JSON.parse(body) as Omit<Failure, "code">) };
  } catch {
    const found = status ? `the answer ${status}` : "no answer";
    return { code: "file", needed: "an answer from the studio", found, advice: "Look whether morphlet studio still runs." };
  }
}
