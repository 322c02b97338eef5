/** A section through both bodies: what a plane cuts out of their triangles. */

import { ACCENT, FAINT, INK, cleared } from "./canvas.js";
import { dot, rotation } from "./linear.js";

const MARGIN_MM = 8;

/** Segments [[x, y], [x, y]] in which triangles meet the plane n·p = height; axes: the two directions to draw along. */
export function cut({ points, corners }, n, height, axes) {
  const segments = [];
  const above = new Float64Array(points.length / 3);
  const along = (axis, i) => axis[0] * points[3 * i] + axis[1] * points[3 * i + 1] + axis[2] * points[3 * i + 2];
  for (let i = 0; i < above.length; i++) above[i] = along(n, i) - height;
  for (let k = 0; k < corners.length; k += 3) {
    const below = (above[corners[k]] < 0) + (above[corners[k + 1]] < 0) + (above[corners[k + 2]] < 0);
    if (below === 0 || below === 3) continue;
    const ends = [];
    for (let j = 0; j < 3; j++) {
      const [a, b] = [corners[k + j], corners[k + ((j + 1) % 3)]];
      if (above[a] < 0 === above[b] < 0) continue;
      const share = above[a] / (above[a] - above[b]);
      ends.push(axes.map((axis) => along(axis, a) * (1 - share) + along(axis, b) * share));
    }
    segments.push(ends);
  }
  return segments;
}

export class Section {
  constructor(canvas, content, fixed, behind, moving) {
    Object.assign(this, { canvas, view: content.view, fixed: [...fixed, behind], moving });
    this.bounds = [content.view.right, content.view.toward].map((axis) =>
      fixed.reduce(([low, high], { points }) => {
        for (let i = 0; i < points.length; i += 3) {
          const at = dot(axis, points.subarray(i, i + 3));
          [low, high] = [Math.min(low, at), Math.max(high, at)];
        }
        return [low, high];
      }, [Infinity, -Infinity]),
    );
  }

  /** The plane across the patches at `at` [mm] along the map's upward direction. */
  draw(pose, at) {
    const { right, up, toward } = this.view;
    const { context, width, height } = cleared(this.canvas);
    const place = this.placed(width, height);
    const R = rotation(pose);
    const inBody = (axis) => [0, 1, 2].map((k) => R[0][k] * axis[0] + R[1][k] * axis[1] + R[2][k] * axis[2]);
    const shift = [right, toward].map((axis) => dot(axis, pose));
    const body = cut(this.moving, inBody(up), at - dot(up, pose), [right, toward].map(inBody));
    const moved = body.map((ends) => ends.map(([x, y]) => [x + shift[0], y + shift[1]]));
    context.save();
    context.beginPath();
    context.rect(0, 18, width, height - 22);
    context.clip();
    for (const part of this.fixed) lines(context, place, cut(part, up, at, [right, toward]), INK, 1.6);
    lines(context, place, moved, ACCENT, 1.6);
    context.restore();
    this.names(context, width);
  }

  placed(width, height) {
    const [[left, end], [low, high]] = this.bounds;
    const factor = Math.min((width - 40) / (end - left), (height - 36) / (high - low + 4 * MARGIN_MM));
    return ([x, y]) => [0.5 * width + factor * (x - 0.5 * (left + end)), 0.56 * height - factor * (y - 0.5 * (low + high))];
  }

  names(context, width) {
    context.textAlign = "left";
    context.fillStyle = FAINT;
    context.fillText(this.view.names.left, 10, 14);
    context.textAlign = "right";
    context.fillText(this.view.names.right, width - 10, 14);
  }
}

function lines(context, place, segments, colour, width) {
  context.beginPath();
  for (const [a, b] of segments) {
    context.moveTo(...place(a));
    context.lineTo(...place(b));
  }
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.lineCap = "round";
  context.stroke();
}
