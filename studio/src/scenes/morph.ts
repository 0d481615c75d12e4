/** The scene of the Morph tab: the shape at a time, and a clock that plays. */
import { Cell } from "../cell";
import type { Model, Models } from "../models";
import type { Session } from "../session";
import { Body, type Look } from "../view/body";
import { Gestures } from "../view/gestures";
import { placeColour } from "../view/palette";
import { Rig } from "../view/rig";
import type { Stage } from "../view/stage";
import { View } from "../view/view";

/** From one shape to the other and back. */
const SECONDS_PER_WAY = 3;
/** The time under the shape. */
const COVERED = { top: 0, bottom: 100 };
const PAUSE_AT_ENDS_S = 0.4;

export class MorphScene {
  readonly view = new View("The shape between mesh A and mesh B. Arrow keys turn it.", new Rig(), () => COVERED);
  readonly time = new Cell(0);
  readonly playing = new Cell(false);
  readonly look = new Cell<Look>("smooth");
  readonly coloured = new Cell(false);
  readonly #stage: Stage;
  readonly #session: Session;
  readonly #models: Models;
  #body: Body | null = null;
  #model: Model | null = null;
  #seq = 0;
  #last = 0;
  #clock = 0;
  #scrubbing = false;

  constructor(stage: Stage, session: Session, models: Models) {
    this.#stage = stage;
    this.#session = session;
    this.#models = models;
    stage.add(this.view);
    new Gestures(
      this.view,
      { down: () => null, hover: () => undefined, enter: () => undefined, doubleClick: () => undefined },
      () => false,
    );
    models.morph.watch((model) => this.#shown(model));
    models.onChange((slot) => {
      if (slot === "morph") stage.invalidate();
    });
    session.state.watch((state) => {
      if (!state?.morph) this.playing.value = false;
      else if (!this.playing.value && !this.#scrubbing) this.time.value = state.morph.time;
    });
    this.look.watch(() => this.#dress());
    this.coloured.watch(() => this.#dress());
    this.playing.watch((on) => {
      if (on) this.#start();
    });
  }

  /** The person holds the slider, or lets it go. */
  scrub(on: boolean): void {
    this.#scrubbing = on;
    if (on) this.playing.value = false;
  }

  /** Asks for the shape at a time; older questions may stay without an answer. */
  go(time: number): void {
    this.#seq += 1;
    this.time.value = time;
    this.#session.tell({ type: "morph.time", seq: this.#seq, time });
  }

  #start(): void {
    const period = 2 * (SECONDS_PER_WAY + PAUSE_AT_ENDS_S);
    this.#clock = this.time.value * SECONDS_PER_WAY;
    this.#last = performance.now();
    const tick = (now: number): void => {
      if (!this.playing.value) return;
      this.#clock = (this.#clock + (now - this.#last) / 1000) % period;
      this.#last = now;
      const there = Math.min(1, this.#clock / SECONDS_PER_WAY);
      const back = Math.min(1, Math.max(0, (this.#clock - SECONDS_PER_WAY - PAUSE_AT_ENDS_S) / SECONDS_PER_WAY));
      this.go(there - back);
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  #shown(model: Model | null): void {
    this.#body?.dispose();
    this.#body = null;
    this.#model = model;
    if (model) {
      this.#body = new Body(model.surface);
      this.view.add(this.#body.object);
      const ends = [this.#models.source.value, this.#models.target.value].flatMap((end) => (end ? [end.surface.positions] : []));
      this.view.center(model.surface.positions, ...ends);
      this.#dress();
    }
    this.#stage.invalidate();
  }

  #dress(): void {
    if (!this.#body || !this.#model) return;
    this.#body.look = this.look.value;
    if (this.coloured.value) this.#body.paint(placeColour(this.#model.surface.positions.slice(), this.#model.surface.positions));
    else this.#body.paintPlain();
    this.#stage.invalidate();
  }
}
