/** Flat views: the pressure on the fixed surface seen from where the moving body lies, with the trail of the centre of
 * pressure; and sections through both bodies, what a plane cuts out of their triangles. */

import { ACCENT, BONE, FAINT, INK, LINE, cleared, css, line, write } from "./canvas.js";
import { dot, heights, rotation } from "./linear.js";

const SCALE_WIDTH = 10;

/** Where a point (right, up) [mm] lies on a canvas whose middle shows that of the bounds, which fill no more than `room`. */
function placed([[left, end], [low, high]], room, middle) {
  const factor = Math.min(room[0] / (end - left), room[1] / (high - low));
  return ([x, y]) => [middle[0] + factor * (x - 0.5 * (left + end)), middle[1] - factor * (y - 0.5 * (low + high))];
}

export class PressureMap {
  constructor(canvas, content, surfaces) {
    this.canvas = canvas;
    this.content = content;
    this.colours = content.colours.map(css);
    const { right, up } = content.view;
    this.surfaces = surfaces.map(({ points, corners }) => ({ corners, x: heights(right, points), y: heights(up, points) }));
  }

  /** pressures: of each patch; contacts: of each patch, with centre; trail: points of earlier centres by patch. */
  draw(pressures, largest, contacts, trail) {
    const { context, width, height } = cleared(this.canvas);
    const place = (this.place = placed(this.content.view.bounds, [width - 150, height - 44], [0.5 * (width - 46), 0.5 * height]));
    const { width: wide, height: high } = this.canvas;
    if (this.bare?.width !== wide || this.bare.height !== high || this.largest !== largest) {
      for (const surface of this.surfaces) fill(context, place, surface, surface.corners, css(BONE));
      const { left, right, top, bottom } = this.content.view.names;
      const middle = 0.5 * (width - 46);
      write(context, FAINT, [[left, "left", 10, 14], [top, "center", middle, 14], [right, "right", width - 56, 14], [bottom, "center", middle, height - 6]]);
      this.scale(context, width, height, largest);
      this.bare = context.getImageData(0, 0, wide, high); // what stays the same from pose to pose
      this.largest = largest;
    }
    context.putImageData(this.bare, 0, 0);
    pressures.forEach((values, patch) => this.paint(context, place, this.surfaces[patch], values, largest));
    this.trail(context, place, trail);
    for (const { centre } of contacts) if (centre) mark(context, place(this.flat(centre)));
  }

  /** Triangles with two corners or more in contact, in the colour of their mean pressure. */
  paint(context, place, surface, values, largest) {
    const [{ corners }, of, top] = [surface, new Map(), this.colours.length - 1];
    for (let k = 0; k < corners.length; k += 3) {
      const three = [corners[k], corners[k + 1], corners[k + 2]];
      const [a, b, c] = three.map((i) => values[i]);
      if ((a > 0) + (b > 0) + (c > 0) < 2) continue;
      const colour = Math.min(Math.round((top * (a + b + c)) / (3 * largest)), top);
      if (!of.has(colour)) of.set(colour, []);
      of.get(colour).push(...three);
    }
    for (const [colour, loaded] of of) fill(context, place, surface, loaded, this.colours[colour]);
  }

  flat(point) {
    return [dot(this.content.view.right, point), dot(this.content.view.up, point)];
  }

  trail(context, place, trail) {
    Object.assign(context, { strokeStyle: ACCENT, lineWidth: 1.2 });
    for (const points of trail) {
      context.beginPath();
      let drawing = false;
      for (const point of points) {
        if (point) context[drawing ? "lineTo" : "moveTo"](...place(this.flat(point)));
        drawing = Boolean(point);
      }
      context.stroke();
    }
    context.lineWidth = 1;
  }

  /** Colours with their pressures [MPa]. */
  scale(context, width, height, largest) {
    const [x, tall] = [width - 46, height - 60];
    for (let y = 0; y < tall; y++) {
      context.fillStyle = this.colours[Math.round((1 - y / tall) * (this.colours.length - 1))];
      context.fillRect(x, 30 + y, SCALE_WIDTH, 1.5);
    }
    context.strokeStyle = LINE;
    context.strokeRect(x, 30, SCALE_WIDTH, tall);
    const at = (share) => [(share * largest).toFixed(largest < 10 ? 1 : 0), "left", x + 14, 34 + tall * (1 - share)];
    write(context, INK, [["MPa", "left", x - 2, 22], ...[0, 0.5, 1].map(at)]);
  }
}

/** Triangles of a flat surface in one colour. */
function fill(context, place, { x, y }, corners, colour) {
  Object.assign(context, { fillStyle: colour, strokeStyle: colour, lineWidth: 0.5 });
  context.beginPath();
  corners.forEach((i, k) => context[k % 3 ? "lineTo" : "moveTo"](...place([x[i], y[i]])));
  context.fill();
  context.stroke(); // no seams between them
}

function mark(context, [x, y]) {
  for (const [radius, colour] of [[5, "#fff"], [3.2, INK]]) {
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fillStyle = colour;
    context.fill();
  }
}

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
    const [low, high] = view.bounds[2];
    const bounds = [view.bounds[along], [low - 2 * MARGIN_MM, high + 2 * MARGIN_MM]];
    Object.assign(this, { canvas, view, across, moving, bounds, names });
    this.fixed = [...fixed, behind].map((part) => ({ part, of: heights(view[across], part.points) }));
  }

  /** The plane at `at` [mm] along its normal. */
  draw(pose, at) {
    const { [this.across]: up, toward } = this.view;
    const right = this.view[this.across === "up" ? "right" : "up"];
    const { context, width, height } = cleared(this.canvas);
    const place = placed(this.bounds, [width - 40, height - 36], [0.5 * width, 0.56 * height]);
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
}
