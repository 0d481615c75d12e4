/** The colours that carry meaning, told apart by people who are colour-blind too. */
import { Color } from "three";

export type Rgb = readonly [number, number, number];

/** As the GPU wants it: linear. */
function linear(hex: string): Rgb {
  const { r, g, b } = new Color(hex);
  return [r, g, b];
}

export const CLAY = linear("#d9d4cb");
export const OUTSIDE = linear("#c3c8ce");

/** Orange pulls, white follows, blue stays; what is painted by hand is stronger than what follows from it. */
export const ROLE_COLOURS = {
  anchor: linear("#86a9c9"),
  anchorPainted: linear("#2f6fab"),
  free: linear("#f3f0ea"),
  freePainted: linear("#f7e3a1"),
  handle: linear("#e8791a"),
  handleMirrored: linear("#f0ab6c"),
} as const;

/** After Paul Tol's palettes for qualitative data. */
const QUALITATIVE = [
  "#4477aa",
  "#ee6677",
  "#228833",
  "#ccbb44",
  "#66ccee",
  "#aa3377",
  "#ee8866",
  "#44bb99",
  "#bbcc33",
  "#99ddff",
  "#ffaabb",
  "#77aadd",
];
const QUALITATIVE_LINEAR = QUALITATIVE.map(linear);

export function qualitative(index: number): Rgb {
  return QUALITATIVE_LINEAR[index % QUALITATIVE.length] ?? CLAY;
}

export function qualitativeHex(index: number): string {
  return QUALITATIVE[index % QUALITATIVE.length] ?? "#999999";
}

/** From none to much, lighter to darker, through warm colours: lightness alone tells the order. */
const SEQUENTIAL = ["#f4f1ea", "#fbd9a5", "#f7a35c", "#e35933", "#a8203d", "#560f3a"].map(linear);
export const SEQUENTIAL_CSS = "linear-gradient(90deg, #f4f1ea, #fbd9a5, #f7a35c, #e35933, #a8203d, #560f3a)";

/** A share from 0 to 1 as a colour. */
export function sequential(share: number): Rgb {
  const place = Math.min(1, Math.max(0, share)) * (SEQUENTIAL.length - 1);
  const index = Math.min(SEQUENTIAL.length - 2, Math.floor(place));
  const [from, to, part] = [SEQUENTIAL[index] ?? CLAY, SEQUENTIAL[index + 1] ?? CLAY, place - index];
  return [from[0] + part * (to[0] - from[0]), from[1] + part * (to[1] - from[1]), from[2] + part * (to[2] - from[2])];
}

const DARKEST = 0.12;
const BRIGHTNESS_RANGE = 0.8;
const GAMMA = 2.2;

/** A colour for a place: red, green and blue from left to right, bottom to top, back to front of a mesh. */
export function placeColour(places: Float32Array, mesh: Float32Array): (vertex: number) => Rgb {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  mesh.forEach((value, at) => {
    low[at % 3] = Math.min(low[at % 3] ?? 0, value);
    high[at % 3] = Math.max(high[at % 3] ?? 0, value);
  });
  const channel = (vertex: number, axis: number): number => {
    const [from, to] = [low[axis] ?? 0, high[axis] ?? 1];
    const share = ((places[3 * vertex + axis] ?? 0) - from) / Math.max(to - from, Number.EPSILON);
    return (DARKEST + BRIGHTNESS_RANGE * Math.min(1, Math.max(0, share))) ** GAMMA;
  };
  return (vertex) => [channel(vertex, 0), channel(vertex, 1), channel(vertex, 2)];
}
