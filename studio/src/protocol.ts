/** What the page and the server say to each other: docs/studio-protocol.md as types. */

export const PROTOCOL = 1;

export type Slot = "source" | "target" | "morph";
export type MeshSlot = "source" | "target";
export type Role = "handle" | "free" | "anchor";
export type PaintMode = "set" | "add" | "erase";
export type Metric = "geodesic" | "euclidean" | "edges";
export type Triple = [number, number, number];
export type Quadruple = [number, number, number, number];
export type OptionValue = number | string | boolean | number[];
export type Axis = "x" | "y" | "z";
export type Plane = { axis: Axis } | { point: Triple; normal: Triple };
export type Ending = string;

export interface Transform {
  translate: Triple;
  rotate: Quadruple;
  scale: Triple;
}

export interface BandTiming {
  start: number;
  duration: number;
  easing: string;
}

export type Request =
  | { type: "hello"; protocol: number }
  | { type: "ack"; frame: number }
  | { type: "sample"; slot: MeshSlot; name: string }
  | { type: "close"; slot: MeshSlot }
  | { type: "paint"; role: Role; mode: PaintMode; vertices: number[] }
  | { type: "roi"; radius: number | null; metric: Metric; live?: boolean }
  | { type: "method"; name: string; options: Record<string, OptionValue>; weight: number | null; live?: boolean }
  | { type: "symmetry"; plane: Plane | null }
  | { type: "drag.begin" }
  | { type: "drag.move"; seq: number; transform: Transform }
  | { type: "drag.end"; seq: number; transform: Transform }
  | { type: "drag.cancel" }
  | { type: "transform"; transform: Transform }
  | { type: "edit.next" }
  | { type: "reset"; what: "transform" | "all" }
  | { type: "undo" }
  | { type: "redo" }
  | { type: "display"; distortion: boolean }
  | { type: "pose.keep"; name?: string }
  | { type: "pose.remove"; index: number }
  | { type: "marker.add"; source: number; target: number; label?: string }
  | { type: "marker.move"; index: number; slot: MeshSlot; vertex: number }
  | { type: "marker.label"; index: number; label: string }
  | { type: "marker.remove"; index: number }
  | { type: "markers.clear" }
  | { type: "markers.take" }
  | { type: "regions" }
  | { type: "correspond" }
  | { type: "morph"; path: string }
  | { type: "morph.time"; seq: number; time: number }
  | { type: "morph.schedule"; bands: BandTiming[] }
  | { type: "cancel" }
  | { type: "recover"; name: string }
  | { type: "discard"; name: string };

export interface Problem {
  needed: string;
  found: string;
  advice: string;
}

export interface MeshState {
  name: string;
  mesh: number;
  vertices: number;
  faces: number;
  diagonal: number;
  center: Triple;
  fingerprint: string;
  repairs: { what: string; count: number }[];
  edited: boolean;
}

export interface EditState {
  number: number;
  handle: { count: number; mirrored: number; center: Triple | null };
  free: number;
  anchors: number;
  painted: Record<Role, number>;
  radius: number | null;
  metric: Metric;
  method: { name: string; options: Record<string, OptionValue> };
  weight: number | null;
  symmetry: Plane | null;
  transform: Transform;
  ready: boolean;
  problem: Problem | null;
}

export interface Numbers {
  frame_ms: number | null;
  iterations: number | null;
  energy: number | null;
  rate: number | null;
  volume_change: number | null;
  edge_strain: number | null;
}

export interface Pair {
  source: number;
  target: number;
  label: string;
}

export interface RegionSet {
  tips: number[];
  core: number;
}

export interface State {
  type: "state";
  revision: number;
  meshes: Record<Slot, MeshState | null>;
  edit: EditState | null;
  drag: number | null;
  history: { undo: string | null; redo: string | null };
  display: { distortion: boolean };
  numbers: Numbers | null;
  poses: { name: string }[];
  markers: Pair[];
  regions: { source: RegionSet; target: RegionSet; pairs: [number, number][]; contested: boolean } | null;
  match: { current: boolean; figures: Record<string, unknown>; warnings: string[]; ambiguous: boolean; pairs: Pair[] } | null;
  morph: { path: string; bands: number; schedule: BandTiming[]; time: number; current: boolean } | null;
  job: { job: number; kind: string; stage: string; share: number | null } | null;
  recoverable: { name: string; meshes: string[]; edits: number; saved: string }[];
}

export type MethodOption = { name: string; title: string } & (
  | { kind: "number"; default: number; low: number; high: number }
  | { kind: "choice"; default: string; choices: string[] }
  | { kind: "flag"; default: boolean }
  | { kind: "counts"; default: number[]; length: number; low: number; high: number }
);

export interface Method {
  name: string;
  title: string;
  soft: boolean;
  options: MethodOption[];
}

export interface Hello {
  type: "hello";
  protocol: number;
  version: string;
  client: number;
  limits: Record<string, number>;
  methods: Method[];
  samples: (string | { name: string; title?: string })[];
  easings: string[];
  paths: string[];
  formats: string[];
}

export interface Failure extends Problem {
  code: string;
  elements?: number[];
}

export type Reply =
  | Hello
  | State
  | { type: "done"; id: number }
  | ({ type: "error"; id: number | null } & Failure)
  | ({ type: "numbers"; slot: Slot; seq: number } & Numbers)
  | { type: "progress"; job: number; kind: string; stage: string; share: number | null }
  | { type: "job"; job: number; kind: string; status: "started" | "done" | "failed" | "cancelled"; error: Failure | null };
