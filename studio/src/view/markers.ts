/** Numbered discs on a mesh: always the same size on the screen, faint where the surface faces away. */
import { CanvasTexture, SRGBColorSpace, Sprite, SpriteMaterial, Vector3 } from "three";
import { qualitativeHex } from "./palette";
import type { Surface } from "./surface";
import type { Spot, View } from "./view";

const DISC_PX = 26;
const DOT_PX = 13;
const TEXTURE_PX = 64;
const REACH_PX = 17;
const FAINT = 0.28;

export interface Mark {
  vertex: number;
  /** On the disc; none on a dot. */
  text: string;
  /** Which colour. */
  index: number;
}

export class MarkLayer {
  readonly #view: View;
  #surface: Surface | null = null;
  #marks: Mark[] = [];
  #sprites: Sprite[] = [];
  #moved: { index: number; vertex: number } | null = null;

  constructor(view: View) {
    this.#view = view;
    view.beforeDraw(() => this.#place());
  }

  show(surface: Surface | null, marks: readonly Mark[]): void {
    if (surface === this.#surface && JSON.stringify(marks) === JSON.stringify(this.#marks)) return;
    this.#surface = surface;
    this.#marks = [...marks];
    for (const sprite of this.#sprites) {
      sprite.removeFromParent();
      sprite.material.map?.dispose();
      sprite.material.dispose();
    }
    this.#sprites = marks.map((mark) => disc(mark));
    this.#view.add(...this.#sprites);
  }

  /** Shows a mark elsewhere while it is dragged. */
  drag(index: number, vertex: number | null): void {
    this.#moved = vertex === null ? null : { index, vertex };
  }

  /** The disc at a spot. */
  at(spot: Spot): number | null {
    const distances = this.#marks.map((mark, index) => (mark.text && this.#faces(mark.vertex) ? this.#distance(index, spot) : Infinity));
    const least = Math.min(...distances);
    return least <= REACH_PX ? distances.indexOf(least) : null;
  }

  #distance(index: number, spot: Spot): number {
    const seen = this.#view.pixel(this.#point(index));
    return Math.hypot(seen.x - spot.x, seen.y - spot.y);
  }

  #vertex(index: number): number {
    return this.#moved?.index === index ? this.#moved.vertex : (this.#marks[index]?.vertex ?? 0);
  }

  #point(index: number): Vector3 {
    return this.#surface?.point(this.#vertex(index), new Vector3()) ?? new Vector3();
  }

  #faces(vertex: number): boolean {
    if (!this.#surface) return false;
    const way = this.#surface.point(vertex, new Vector3()).sub(this.#view.camera.position);
    return way.dot(this.#surface.normal(vertex, new Vector3())) < 0;
  }

  #place(): void {
    const perPixel = (2 * Math.tan((this.#view.camera.fov * Math.PI) / 360)) / this.#view.size.height;
    this.#sprites.forEach((sprite, index) => {
      sprite.position.copy(this.#point(index));
      sprite.scale.setScalar(perPixel * (this.#marks[index]?.text ? DISC_PX : DOT_PX));
      sprite.material.opacity = this.#faces(this.#vertex(index)) ? 1 : FAINT;
    });
  }
}

function disc(mark: Mark): Sprite {
  const material = new SpriteMaterial({ map: picture(mark), sizeAttenuation: false, depthTest: false, transparent: true });
  return new Sprite(material);
}

function picture({ text, index }: Mark): CanvasTexture {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = TEXTURE_PX;
  const pen = canvas.getContext("2d");
  if (pen) {
    const middle = TEXTURE_PX / 2;
    pen.beginPath();
    pen.arc(middle, middle, middle - 4, 0, 2 * Math.PI);
    pen.fillStyle = qualitativeHex(index);
    pen.strokeStyle = "#ffffff";
    pen.lineWidth = 6;
    pen.fill();
    pen.stroke();
    pen.font = `700 ${text.length > 1 ? 28 : 34}px system-ui, sans-serif`;
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.lineWidth = 5;
    pen.strokeStyle = "rgb(0 0 0 / 55%)";
    pen.strokeText(text, middle, middle + 2);
    pen.fillStyle = "#ffffff";
    pen.fillText(text, middle, middle + 2);
  }
  const texture = new CanvasTexture(canvas);
  texture.colorSpace = SRGBColorSpace;
  return texture;
}
