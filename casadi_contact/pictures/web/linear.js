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

/** x of A x = b by elimination with pivots; A: rows. */
export function solved(A, b) {
  const n = b.length;
  const rows = A.map((row, i) => [...row, b[i]]);
  for (let i = 0; i < n; i++) {
    const pivot = rows.slice(i).reduce((best, row, k) => (Math.abs(row[i]) > Math.abs(rows[best][i]) ? i + k : best), i);
    [rows[i], rows[pivot]] = [rows[pivot], rows[i]];
    for (let k = i + 1; k < n; k++) {
      const factor = rows[k][i] / rows[i][i];
      for (let j = i; j <= n; j++) rows[k][j] -= factor * rows[i][j];
    }
  }
  const x = new Array(n).fill(0);
  for (let i = n - 1; i >= 0; i--) {
    x[i] = (rows[i][n] - rows[i].slice(i + 1, n).reduce((sum, part, k) => sum + part * x[i + 1 + k], 0)) / rows[i][i];
  }
  return x;
}

/** Least squares: x that makes J x nearest to b, a trace of damping for a singular J. */
export function leastSquares(J, b) {
  const n = J[0].length;
  const normal = Array.from({ length: n }, (_, i) =>
    Array.from({ length: n }, (_, j) => J.reduce((sum, row) => sum + row[i] * row[j], 0)),
  );
  const trace = normal.reduce((sum, row, i) => sum + row[i], 1e-12);
  normal.forEach((row, i) => (row[i] += 1e-11 * trace));
  return solved(normal, normal.map((_, i) => J.reduce((sum, row, k) => sum + row[i] * b[k], 0)));
}
