/**
 * Materials with the shortest programs: colours as they are, without conversions for every pixel,
 * so that a processor without graphics draws them in time.
 */

import { DoubleSide, ShaderMaterial, Color } from "three";

const OPAQUE = `
  varying vec3 tint;
  void main() { gl_FragColor = vec4(tint, 1.0); }
`;
const PLACE = "gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);";

/** A surface in the colours of its vertices; in space darker where it is turned away. */
export function surfaceMaterial(d: number): ShaderMaterial {
  const shade = d === 2 ? "1.0" : "0.62 + 0.38 * abs(normalize(normalMatrix * normal).z)";
  return new ShaderMaterial({
    vertexShader: `
      attribute vec3 colour;
      varying vec3 tint;
      void main() { tint = colour * (${shade}); ${PLACE} }
    `,
    fragmentShader: OPAQUE,
    side: DoubleSide,
    polygonOffset: true,
    polygonOffsetFactor: 1,
    polygonOffsetUnits: 1,
  });
}

/** A surface of one colour, shaded as the body is. */
export function shadedMaterial(colour: number, d: number): ShaderMaterial {
  const shade = d === 2 ? "1.0" : "0.45 + 0.55 * abs(normalize(normalMatrix * normal).z)";
  const material = plainMaterial(colour, 1);
  material.transparent = false;
  material.vertexShader = `
    uniform vec3 colour;
    varying vec3 tint;
    void main() { tint = colour * (${shade}); ${PLACE} }
  `;
  material.fragmentShader = OPAQUE;
  return material;
}

/** Lines or faces of one colour. */
export function plainMaterial(colour: number, opacity: number): ShaderMaterial {
  return new ShaderMaterial({
    uniforms: { colour: { value: rgb(colour) }, opacity: { value: opacity } },
    vertexShader: `void main() { ${PLACE} }`,
    fragmentShader: `
      uniform vec3 colour;
      uniform float opacity;
      void main() { gl_FragColor = vec4(colour, opacity); }
    `,
    transparent: true,
    side: DoubleSide,
  });
}

/** Discs of one colour and size in pixels of the page. */
export function discMaterial(colour: number, opacity: number, size: number): ShaderMaterial {
  const pixels = (size * window.devicePixelRatio).toFixed(1);
  const material = plainMaterial(colour, opacity);
  material.vertexShader = `void main() { ${PLACE} gl_PointSize = ${pixels}; }`;
  material.fragmentShader = `
    uniform vec3 colour;
    uniform float opacity;
    void main() {
      float away = length(gl_PointCoord - 0.5) * ${pixels};
      gl_FragColor = vec4(colour, opacity * clamp(0.5 * ${pixels} - away, 0.0, 1.0));
    }
  `;
  return material;
}

/** Components of a colour as they are shown. */
export function rgb(colour: number): Color {
  return new Color((colour >> 16) / 255, ((colour >> 8) & 255) / 255, (colour & 255) / 255);
}
