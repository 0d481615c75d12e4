/** How a mesh is looked at, in units of its own size: views that share a rig are linked. */
import { Matrix4, type PerspectiveCamera, Quaternion, Vector3 } from "three";

export type Up = "y" | "z";

const START = { yaw: 0.5, pitch: 0.25 };
const STEEPEST = Math.PI / 2 - 0.01;
const ZOOM_RANGE = [0.2, 40] as const;
const MARGIN = 0.98;
const UP_AXES: Record<Up, Quaternion> = {
  y: new Quaternion(),
  z: new Quaternion().setFromAxisAngle(new Vector3(1, 0, 0), Math.PI / 2),
};

export interface Ball {
  center: Vector3;
  radius: number;
}

export class Rig {
  yaw = START.yaw;
  pitch = START.pitch;
  zoom = 1;
  /** Where the middle of the picture is: from the middle of the mesh, in radii. */
  readonly offset = new Vector3();
  up: Up = "y";
  readonly #listeners = new Set<() => void>();

  onChange(listener: () => void): void {
    this.#listeners.add(listener);
  }

  /** By fractions of the view's height. */
  turn(right: number, down: number): void {
    this.yaw -= right * Math.PI;
    this.pitch = Math.min(STEEPEST, Math.max(-STEEPEST, this.pitch + down * Math.PI));
    this.#tell();
  }

  /** By fractions of the view's height. */
  pan(right: number, down: number): void {
    const { x, y } = this.#axes();
    const height = (2 * MARGIN) / this.zoom;
    this.offset.addScaledVector(x, -right * height).addScaledVector(y, down * height);
    this.#tell();
  }

  dolly(factor: number): void {
    this.zoom = Math.min(ZOOM_RANGE[1], Math.max(ZOOM_RANGE[0], this.zoom * factor));
    this.#tell();
  }

  look(yaw: number, pitch: number): void {
    this.yaw = yaw;
    this.pitch = Math.min(STEEPEST, Math.max(-STEEPEST, pitch));
    this.#tell();
  }

  /** The whole mesh, from where one looks now. */
  frame(): void {
    this.offset.set(0, 0, 0);
    this.zoom = 1;
    this.#tell();
  }

  focus(point: Vector3, ball: Ball): void {
    this.offset.copy(point).sub(ball.center).divideScalar(ball.radius);
    this.#tell();
  }

  stand(up: Up): void {
    this.up = up;
    this.#tell();
  }

  /** Another one that looks from the same place, and then goes its own way. */
  copy(): Rig {
    const twin = new Rig();
    Object.assign(twin, { yaw: this.yaw, pitch: this.pitch, zoom: this.zoom, up: this.up });
    twin.offset.copy(this.offset);
    return twin;
  }

  /** `free`: share of the height that the mesh may fill. */
  place(camera: PerspectiveCamera, ball: Ball, aspect: number, free: number): void {
    const { z, y } = this.#axes();
    const half = (camera.fov * Math.PI) / 360;
    const narrow = Math.min(free, aspect);
    const distance = (MARGIN * ball.radius) / Math.sin(half) / narrow / this.zoom;
    const target = new Vector3().copy(this.offset).multiplyScalar(ball.radius).add(ball.center);
    camera.aspect = aspect;
    camera.up.copy(y);
    camera.position.copy(target).addScaledVector(z, distance);
    camera.lookAt(target);
    camera.near = Math.max(distance - 4 * ball.radius, distance / 100);
    camera.far = distance + 4 * ball.radius + this.offset.length() * ball.radius;
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
  }

  #axes(): { x: Vector3; y: Vector3; z: Vector3 } {
    const x = new Vector3(Math.cos(this.yaw), 0, -Math.sin(this.yaw));
    const z = new Vector3(Math.sin(this.yaw) * Math.cos(this.pitch), Math.sin(this.pitch), Math.cos(this.yaw) * Math.cos(this.pitch));
    const y = new Vector3().crossVectors(z, x);
    const turned = new Matrix4().makeRotationFromQuaternion(UP_AXES[this.up]);
    return { x: x.applyMatrix4(turned), y: y.applyMatrix4(turned), z: z.applyMatrix4(turned) };
  }

  #tell(): void {
    for (const listener of this.#listeners) listener();
  }
}
