/**
 * Materials with the shortest programs: colours as they are, without conversions for every pixel,
 * so that a processor without graphics draws them in time.
 */

import { Color, ColorManagement, DoubleSide, ShaderMaterial } from "three";

ColorManagement.enabled = false; // components are as they are shown

interface Look {
  /** Of all that is drawn; by default that of the vertices, in front of which lines are drawn. */
  colour?: number;
  /** Less than 1 where one looks through; by default there is no blending at all. */
  opacity?: number;
  /** How much darker faces are that are turned away. */
  shade?: number;
  /** Diameter of points in pixels of the page. */
  size?: number;
}

export function material({ colour, opacity, shade = 0, size = 0 }: Look): ShaderMaterial {
  const isOwn = colour === undefined;
  const pixels = (size * window.devicePixelRatio).toFixed(1);
  const light =
    shade > 0 ? `${1 - shade} + ${shade} * abs(normalize(normalMatrix * normal).z)` : "1.0";
  const disc = `clamp(0.5 * ${pixels} - length(gl_PointCoord - 0.5) * ${pixels}, 0.0, 1.0)`;
  return new ShaderMaterial({
    uniforms: { colour: { value: new Color(colour ?? 0) }, opacity: { value: opacity ?? 1 } },
    vertexShader: `
      ${isOwn ? "attribute" : "uniform"} vec3 colour;
      varying vec3 tint;
      void main() {
        tint = colour * (${light});
        gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
        gl_PointSize = ${pixels};
      }
    `,
    fragmentShader: `
      uniform float opacity;
      varying vec3 tint;
      void main() { gl_FragColor = vec4(tint, opacity * ${size > 0 ? disc : "1.0"}); }
    `,
    transparent: opacity !== undefined,
    side: DoubleSide,
    polygonOffset: isOwn,
    polygonOffsetFactor: 1,
    polygonOffsetUnits: 1,
  });
}
