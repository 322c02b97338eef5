/** A section through both bodies: what a plane cuts out of their triangles. */

import { ACCENT, FAINT, INK, cleared, line, write } from "./canvas.js";
import { dot, heights, rotation } from "./linear.js";

const MARGIN_MM = 8;

/** Segments [[x, y], [x, y]] in which triangles meet the plane at a height; axes: the two directions to draw along. */
export function cut({ points, corners }, heightOf, height, axes) {
  const segments = [];
  const along = (axis, i) => dot(axis, points.subarray(3 * i, 3 * i + 3));
  for (let k = 0; k < corners.length; k += 3) {
    const first = heightOf[corners[k]] < height;
    if (first === heightOf[corners[k + 1]] < height && first === heightOf[corners[k + 2]] < height) continue;
    const ends = [];
    for (let j = 0; j < 3; j++) {
      const [a, b] = [corners[k + j], corners[k + ((j + 1) % 3)]];
      if (heightOf[a] < height === heightOf[b] < height) continue;
      const share = (heightOf[a] - height) / (heightOf[a] - heightOf[b]);
      ends.push(axes.map((axis) => along(axis, a) * (1 - share) + along(axis, b) * share));
    }
    segments.push(ends);
  }
  return segments;
}

export class Section {
  /** across: the map's direction that the plane is normal to, "up" or "right". */
  constructor(canvas, { view }, across, fixed, behind, moving) {
    const [along, names] = across === "up" ? [0, ["left", "right"]] : [1, ["bottom", "top"]];
    Object.assign(this, { canvas, view, across, moving, bounds: [view.bounds[along], view.bounds[2]], names });
    this.fixed = [...fixed, behind].map((part) => ({ part, of: heights(view[across], part.points) }));
  }

  /** The plane at `at` [mm] along its normal. */
  draw(pose, at) {
    const { [this.across]: up, toward } = this.view;
    const right = this.view[this.across === "up" ? "right" : "up"];
    const { context, width, height } = cleared(this.canvas);
    const place = this.placed(width, height);
    const R = rotation(pose);
    const inBody = (axis) => [0, 1, 2].map((k) => R[0][k] * axis[0] + R[1][k] * axis[1] + R[2][k] * axis[2]);
    const shift = [right, toward].map((axis) => dot(axis, pose));
    const body = cut(this.moving, heights(inBody(up), this.moving.points), at - dot(up, pose), [right, toward].map(inBody));
    const moved = body.map((ends) => ends.map(([x, y]) => [x + shift[0], y + shift[1]]));
    context.save();
    context.beginPath();
    context.rect(0, 18, width, height - 22);
    context.clip();
    Object.assign(context, { lineWidth: 1.6, lineCap: "round", strokeStyle: INK });
    for (const { part, of } of this.fixed) for (const ends of cut(part, of, at, [right, toward])) line(context, ends.map(place));
    context.strokeStyle = ACCENT;
    for (const ends of moved) line(context, ends.map(place));
    context.restore();
    write(context, FAINT, this.names.map((way, i) => [this.view.names[way], i ? "right" : "left", i ? width - 10 : 10, 14]));
  }

  placed(width, height) {
    const [[left, end], [low, high]] = this.bounds;
    const factor = Math.min((width - 40) / (end - left), (height - 36) / (high - low + 4 * MARGIN_MM));
    return ([x, y]) => [0.5 * width + factor * (x - 0.5 * (left + end)), 0.56 * height - factor * (y - 0.5 * (low + high))];
  }
}
