/** A rigid sphere, or a disc in the plane: its distance g(x) = |x − c| − R, gradient and Hessian. */

export interface Sphere {
  /** d components in m. */
  centre: number[];
  /** In m. */
  radius: number;
}

/** What a sphere is at a position. */
export interface Near {
  /** Signed distance in m, positive outside. */
  gap: number;
  /** Gradient of the distance, n. */
  normal: number[];
  /** Hessian (I − n nᵀ) / |x − c| in 1/m, (d · d). */
  curvature: number[];
}

/** The sphere at a position in m. */
export function near({ centre, radius }: Sphere, x: ArrayLike<number>): Near {
  const offset = centre.map((value, i) => x[i] - value);
  const length = Math.hypot(...offset);
  const normal = offset.map((value, i) => (length > 0 ? value / length : Number(i === 0)));
  const curvature = normal.flatMap((a, i) =>
    normal.map((b, j) => (length > 0 ? (Number(i === j) - a * b) / length : 0)),
  );
  return { gap: length - radius, normal, curvature };
}
