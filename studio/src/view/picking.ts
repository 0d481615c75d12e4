/** Which vertices a pointer means. */
import { DoubleSide, Ray, Vector3 } from "three";
import { MeshBVH } from "three-mesh-bvh";
import type { Surface } from "./surface";
import type { Spot, View } from "./view";

/** How far a vertex may lie behind what is seen, in radii of the mesh, and still be visible. */
const VISIBLE_SLACK = 2e-3;

/** Where to look when a pointer just misses, in pixels. */
const MISS_PX = 5;
const RING = Array.from({ length: 8 }, (_, k) => ({ x: MISS_PX * Math.cos((k * Math.PI) / 4), y: MISS_PX * Math.sin((k * Math.PI) / 4) }));

export interface Hit {
  point: Vector3;
  vertex: number;
  face: number;
}

export class Picker {
  readonly #surface: Surface;
  #tree: MeshBVH | null = null;
  #treeRevision = -1;
  #neighbours: { starts: Uint32Array; faces: Uint32Array } | null = null;

  constructor(surface: Surface) {
    this.#surface = surface;
  }

  /** What a ray meets first. */
  hit(ray: Ray): Hit | null {
    const found = this.#current().raycastFirst(ray, DoubleSide);
    if (!found || found.faceIndex == null) return null;
    return { point: found.point, face: found.faceIndex, vertex: this.#nearestCorner(found.faceIndex, found.point) };
  }

  /** What a pointer means at a pixel: what is under it or, just beside the mesh, next to it. */
  near(view: View, spot: Spot): Hit | null {
    const tries = [spot, ...RING.map(({ x, y }) => ({ x: spot.x + x, y: spot.y + y }))];
    for (const one of tries) {
      const hit = this.hit(view.ray(one));
      if (hit) return hit;
    }
    return null;
  }

  /** The vertices of the piece of surface around a hit that lies in a ball. */
  around(hit: Hit, radius: number): number[] {
    const { faces, positions } = this.#surface;
    const { starts, faces: around } = this.#fans();
    const place = new Vector3();
    const inside = (vertex: number): boolean => place.fromArray(positions, 3 * vertex).distanceTo(hit.point) <= radius;
    const found = new Set<number>([hit.vertex]);
    const queue = [hit.vertex];
    for (let vertex = queue.pop(); vertex !== undefined; vertex = queue.pop()) {
      for (let at = starts[vertex] ?? 0; at < (starts[vertex + 1] ?? 0); at++) {
        for (let corner = 0; corner < 3; corner++) {
          const next = faces[3 * (around[at] ?? 0) + corner] ?? 0;
          if (found.has(next) || !inside(next)) continue;
          found.add(next);
          queue.push(next);
        }
      }
    }
    return [...found];
  }

  /** The vertices whose pixels a test accepts; only those in sight, unless `through`. */
  inside(view: View, accepts: (spot: Spot) => boolean, through: boolean): number[] {
    const { width, height } = view.size;
    view.prepare(width / height);
    const seen = new Vector3();
    const chosen: number[] = [];
    for (let vertex = 0; vertex < this.#surface.count; vertex++) {
      this.#surface.point(vertex, seen).project(view.camera);
      if (seen.z > 1 || !accepts({ x: ((seen.x + 1) / 2) * width, y: ((1 - seen.y) / 2) * height })) continue;
      if (through || this.visible(view, vertex)) chosen.push(vertex);
    }
    return chosen;
  }

  /** Whether nothing stands before a vertex. */
  visible(view: View, vertex: number): boolean {
    const eye = view.camera.position;
    const point = this.#surface.point(vertex, new Vector3());
    const way = point.sub(eye);
    if (way.dot(this.#surface.normal(vertex, new Vector3())) > 0) return false;
    const distance = way.length();
    const ray = new Ray(eye, way.divideScalar(distance));
    const first = this.#current().raycastFirst(ray, DoubleSide, 0, distance - VISIBLE_SLACK * view.ball.radius);
    return first === null;
  }

  /** The vertex nearest to a point, through space. */
  nearest(point: Vector3): number {
    const found = this.#current().closestPointToPoint(point);
    return found ? this.#nearestCorner(found.faceIndex, found.point) : 0;
  }

  #nearestCorner(face: number, point: Vector3): number {
    const place = new Vector3();
    const corners = [0, 1, 2].map((corner) => this.#surface.faces[3 * face + corner] ?? 0);
    const distance = (vertex: number): number => this.#surface.point(vertex, place).distanceToSquared(point);
    return corners.reduce((best, vertex) => (distance(vertex) < distance(best) ? vertex : best));
  }

  #current(): MeshBVH {
    if (!this.#tree) this.#tree = new MeshBVH(this.#surface.geometry, { indirect: true });
    else if (this.#treeRevision !== this.#surface.revision) this.#tree.refit();
    this.#treeRevision = this.#surface.revision;
    return this.#tree;
  }

  #fans(): { starts: Uint32Array; faces: Uint32Array } {
    if (this.#neighbours) return this.#neighbours;
    const { faces, count } = this.#surface;
    const starts = new Uint32Array(count + 1);
    for (const vertex of faces) starts[vertex + 1] = (starts[vertex + 1] ?? 0) + 1;
    for (let vertex = 0; vertex < count; vertex++) starts[vertex + 1] = (starts[vertex + 1] ?? 0) + (starts[vertex] ?? 0);
    const next = starts.slice();
    const around = new Uint32Array(faces.length);
    faces.forEach((vertex, corner) => {
      const at = next[vertex] ?? 0;
      around[at] = Math.floor(corner / 3);
      next[vertex] = at + 1;
    });
    this.#neighbours = { starts, faces: around };
    return this.#neighbours;
  }
}
