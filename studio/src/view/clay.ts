/** How a surface is lit: a lamp behind the viewer's left shoulder, sky above, ground below; its own short shader, soon compiled. */
import { Color, DoubleSide, ShaderMaterial } from "three";

/** Towards the lamp, as the camera sees it. */
const LAMP = "normalize(vec3(-0.6, 0.9, 1.0))";
const LAMP_STRENGTH = 2.1;
const SKY_STRENGTH = 1.6;
const GROUND = new Color("#7d8794");
const GLOSS = new Color("#1c1c1c");
const SHININESS = 24;

const VERTEX = /* glsl */ `
varying vec3 toViewer;
varying vec3 outward;
varying vec3 tint;
void main() {
  vec4 place = modelViewMatrix * vec4(position, 1.0);
  toViewer = -place.xyz;
  outward = normalMatrix * normal;
  tint = color;
  gl_Position = projectionMatrix * place;
}`;

/** After Blinn and Phong, in physical units: a surface sends back 1/pi of its light per solid angle. */
const FRAGMENT = /* glsl */ `
uniform bool flatly;
varying vec3 toViewer;
varying vec3 outward;
varying vec3 tint;
void main() {
  vec3 facet = normalize(cross(dFdx(toViewer), dFdy(toViewer)));
  vec3 normal = flatly ? facet : normalize(outward) * (gl_FrontFacing ? 1.0 : -1.0);
  vec3 up = normalize((viewMatrix * vec4(0.0, 1.0, 0.0, 0.0)).xyz);
  vec3 around = ${SKY_STRENGTH.toFixed(1)} * mix(${vector(GROUND)}, vec3(1.0), 0.5 * dot(normal, up) + 0.5);
  vec3 lamp = ${LAMP};
  vec3 between = normalize(lamp + normalize(toViewer));
  float direct = ${LAMP_STRENGTH.toFixed(1)} * max(dot(normal, lamp), 0.0);
  float grazing = pow(1.0 - max(dot(normalize(toViewer), between), 0.0), 5.0);
  float shine = 0.25 * ${(SHININESS / 2 + 1).toFixed(1)} * pow(max(dot(normal, between), 0.0), ${SHININESS.toFixed(1)});
  vec3 gloss = mix(${vector(GLOSS)}, vec3(1.0), grazing) * shine;
  gl_FragColor = vec4((tint * (around + direct) + gloss * direct) / 3.14159265, 1.0);
  #include <colorspace_fragment>
}`;

/** A colour as the shader reads it: linear. */
function vector({ r, g, b }: Color): string {
  return `vec3(${[r, g, b].map((share) => share.toFixed(5)).join(", ")})`;
}

export class Clay extends ShaderMaterial {
  constructor() {
    super({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: { flatly: { value: false } },
      vertexColors: true,
      side: DoubleSide,
      // Pushes the faces back a little, so that lines on them are seen.
      polygonOffset: true,
      polygonOffsetFactor: 1,
      polygonOffsetUnits: 1,
    });
  }

  /** One colour per face instead of a smooth one. */
  set flatly(on: boolean) {
    const uniform = this.uniforms["flatly"];
    if (uniform) uniform.value = on;
  }
}
