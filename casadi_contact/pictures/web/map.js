/** The pressure on the fixed surface seen from where the moving body lies, with the trail of the centre of pressure. */

import { ACCENT, BONE, FAINT, INK, LINE, cleared, css, write } from "./canvas.js";
import { dot, heights } from "./linear.js";

const SCALE_WIDTH = 10;

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
    const place = this.placed(width, height);
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

  /** Where a point (right, up) [mm] lies on the canvas. */
  placed(width, height) {
    const [[left, end], [low, high]] = this.content.view.bounds;
    const factor = Math.min((width - 150) / (end - left), (height - 44) / (high - low));
    const centre = 0.5 * (width - 46);
    return ([x, y]) => [centre + factor * (x - 0.5 * (left + end)), 0.5 * height - factor * (y - 0.5 * (low + high))];
  }

  trail(context, place, trail) {
    context.strokeStyle = ACCENT;
    context.lineWidth = 1.2;
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
    const x = width - 46;
    const tall = height - 60;
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
