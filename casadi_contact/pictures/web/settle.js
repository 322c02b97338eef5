/** Settling: the free pose parameters that carry wanted loads, by damped Newton steps on root loads, as cc.settle. */

import { dot, leastSquares, poseSpace, scaled, size } from "./linear.js";

const LEVER_MM = 25;
const LIMIT_MM = 2;
const MOST_STEPS = 60;
const TOLERANCE_N = 1e-5;

/** r, dr/dpose (rows of 6) and the largest misfit [N] of a pose; target: {names, wanted}. */
function residuals(model, content, pose, target) {
  const [{ values, slopes }, roots] = ["jacobian", "roots"].map((what) => model.both(what, pose));
  const column = (name) => model.names.indexOf(name);
  const row = (from, k) => Array.from(from.slice(6 * k, 6 * k + 6));
  const rows = content.normals.flatMap(({ loads, directed, sign }, patch) => {
    const wanted = loads.map((name) => target.wanted[target.names.indexOf(name)]);
    const [s, ds] = [roots.values[patch], row(roots.slopes, patch)];
    if (directed) return [[s - Math.sqrt(Math.max(sign * wanted[0], 0) / content.referenceLoad), ds]];
    const [force, by] = [loads.map((name) => values[column(name)]), loads.map((name) => row(slopes, column(name)))];
    const { vector, slope } = rootVector(force, by, s, ds, content.referenceLoad);
    const root = Math.sqrt(content.referenceLoad * (size(wanted) || 1));
    return vector.map((part, i) => [part - wanted[i] / root, slope[i]]);
  });
  const misfit = target.names.map((name, i) => Math.abs(values[column(name)] - target.wanted[i]));
  return { r: rows.map(([r]) => r), J: rows.map(([, J]) => J), misfit: Math.max(...misfit) };
}

/** F/√(N N0) and its derivatives; out of contact the root load along the way that closes the gap. */
function rootVector(force, by, s, ds, referenceLoad) {
  const N = size(force);
  if (N > 0) {
    const root = Math.sqrt(N * referenceLoad);
    const along = scaled(force, 1 / N);
    const change = (k) => along.reduce((sum, a, j) => sum + a * by[j][k], 0);
    const slope = by.map((row, i) => row.map((part, k) => (part - 0.5 * along[i] * change(k)) / root));
    return { vector: scaled(force, 1 / root), slope };
  }
  const closing = scaled(ds.slice(0, 3), 1 / (Math.sqrt(dot(ds, ds)) || 1));
  return { vector: scaled(closing, s), slope: closing.map((part) => ds.map((of) => part * of)) };
}

/** {pose, converged, steps, misfit [N]}; free: columns of the pose. What the scene ties follows, what it locks stays. */
export function settle(model, content, start, free, target) {
  const scales = free.map((k) => (k < 3 ? 1 : 1 / LEVER_MM));
  const space = poseSpace(content.space);
  const reduced = (J) => J.map(space.along).map((row) => free.map((k, i) => row[k] * scales[i]));
  let pose = space.onto(Array.from(start));
  let [now, fraction, steps] = [residuals(model, content, pose, target), 1, 0];
  for (; steps < MOST_STEPS && now.misfit > TOLERANCE_N; steps++) {
    const J = reduced(now.J);
    const step = leastSquares(J, now.r.map((part) => -part));
    const length = Math.max(...step.map(Math.abs));
    const reach = Math.min(fraction, LIMIT_MM / length);
    const moved = Array.from(pose);
    free.forEach((k, i) => (moved[k] += reach * step[i] * scales[i]));
    const trial = space.onto(moved);
    const next = residuals(model, content, trial, target);
    // Natural monotonicity: the step that is left, by the old Jacobian, must shrink.
    const left = Math.max(...leastSquares(J, next.r).map(Math.abs));
    const better = left <= (1 - 0.25 * reach) * length;
    if (better) [pose, now] = [trial, next];
    fraction = better ? Math.min(1, 2 * fraction) : 0.35 * reach;
    if (!(fraction > 1e-6) || length < 1e-12) break;
  }
  return { pose, converged: now.misfit <= TOLERANCE_N, steps, misfit: now.misfit };
}
