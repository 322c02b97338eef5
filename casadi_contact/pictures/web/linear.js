/** Small linear algebra: rotations of poses, vectors of three, least squares of a few unknowns. */

/** R = Rx(rx) Ry(ry) Rz(rz), row after row. */
export function rotation([, , , rx, ry, rz]) {
  const [sx, sy, sz] = [rx, ry, rz].map(Math.sin);
  const [cx, cy, cz] = [rx, ry, rz].map(Math.cos);
  return [
    [cy * cz, -cy * sz, sy],
    [cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy],
    [sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy],
  ];
}

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const size = (a) => Math.hypot(...a);
export const scaled = (a, factor) => a.map((part) => part * factor);

/** Coordinates n·p of points, one after the other. */
export function heights([x, y, z], points) {
  return Float64Array.from({ length: points.length / 3 }, (_, i) => x * points[3 * i] + y * points[3 * i + 1] + z * points[3 * i + 2]);
}

/** Poses that a joint can take, M q + c, with held: {matrix, offset}, null where all are free: onto(pose), and
 * along(slopes), derivatives by the free parameters from those by the pose. */
export function poseSpace(held) {
  if (!held) return { onto: (pose) => pose, along: (slopes) => slopes };
  const { matrix, offset } = held;
  return {
    onto: (pose) => matrix.map((row, k) => row.reduce((sum, m, j) => sum + m * pose[j], offset[k])),
    along: (slopes) => slopes.map((_, j) => slopes.reduce((sum, slope, k) => sum + slope * matrix[k][j], 0)),
  };
}

/** Least squares: x that makes J x nearest to b, a trace of damping for a singular J; Gauss and Jordan on JᵀJ x = Jᵀb. */
export function leastSquares(J, b) {
  const sum = (of) => J.reduce((total, row, k) => total + of(row, k), 0);
  const rows = J[0].map((_, i) => [...J[0].map((_, j) => sum((row) => row[i] * row[j])), sum((row, k) => row[i] * b[k])]);
  const damping = 1e-11 * rows.reduce((trace, row, i) => trace + row[i], 1e-12);
  rows.forEach((row, i) => (row[i] += damping));
  rows.forEach((pivot, i) => {
    for (const row of rows) {
      const factor = row[i] / pivot[i];
      if (row !== pivot) row.forEach((_, j) => (row[j] -= factor * pivot[j]));
    }
  });
  return rows.map((row, i) => row.at(-1) / row[i]);
}
