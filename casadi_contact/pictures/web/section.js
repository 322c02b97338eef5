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
  constructor(canvas, content, fixed, behind, moving) {
    Object.assign(this, { canvas, view: content.view, moving });
    this.fixed = [...fixed, behind].map((part) => ({ part, of: heights(this.view.up, part.points) }));
  }

  /** The plane across the patches at `at` [mm] along the map's upward direction. */
  draw(pose, at) {
    const { right, up, toward } = this.view;
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
    write(context, FAINT, [[this.view.names.left, "left", 10, 14], [this.view.names.right, "right", width - 10, 14]]);
  }

  placed(width, height) {
    const [[left, end], , [low, high]] = this.view.bounds;
    const factor = Math.min((width - 40) / (end - left), (height - 36) / (high - low + 4 * MARGIN_MM));
    return ([x, y]) => [0.5 * width + factor * (x - 0.5 * (left + end)), 0.56 * height - factor * (y - 0.5 * (low + high))];
  }
}
