/** The pressure on the fixed surface seen from where the moving body lies, with the trail of the centre of pressure. */

import { ACCENT, BONE, FAINT, INK, LINE, cleared, colourOf, css, paintOf } from "./canvas.js";
import { Covered } from "./covered.js";
import { dot } from "./linear.js";

const SCALE_WIDTH = 10;

export class PressureMap {
  constructor(canvas, content, surfaces) {
    this.canvas = canvas;
    this.content = content;
    this.paint = paintOf(content.colours);
    const { right, up } = content.view;
    this.surfaces = surfaces.map(({ points, corners }) => {
      const flat = new Float64Array((2 * points.length) / 3);
      for (let i = 0; i < points.length / 3; i++) {
        const point = points.subarray(3 * i, 3 * i + 3);
        flat[2 * i] = dot(right, point);
        flat[2 * i + 1] = dot(up, point);
      }
      return { flat, corners };
    });
    const of = (k) => this.surfaces.flatMap(({ flat }) => Array.from(flat).filter((_, i) => i % 2 === k));
    this.bounds = [0, 1].map((k) => of(k).reduce(([a, b], x) => [Math.min(a, x), Math.max(b, x)], [Infinity, -Infinity]));
  }

  /** pressures: of each patch; contacts: of each patch, with centre; trail: points of earlier centres by patch. */
  draw(pressures, largest, contacts, trail) {
    const { context, width, height } = cleared(this.canvas);
    const place = this.placed(width, height);
    this.prepare(context, place, width, height, largest);
    this.picture.data.set(this.bare);
    const pixels = new Uint32Array(this.picture.data.buffer);
    pressures.forEach((values, patch) => this.covered[patch].paint(pixels, values, this.paint, largest));
    context.putImageData(this.picture, 0, 0);
    this.trail(context, place, trail);
    for (const { centre } of contacts) if (centre) mark(context, place(this.flat(centre)));
  }

  /** What stays the same from pose to pose: all but the pressure, and which points lie around each pixel. */
  prepare(context, place, width, height, largest) {
    const { width: wide, height: high } = this.canvas;
    const resized = this.picture?.width !== wide || this.picture.height !== high;
    if (!resized && this.largest === largest) return;
    this.largest = largest;
    this.surfaces.forEach((surface) => fill(context, place, surface));
    this.names(context, width, height);
    this.scale(context, width, height, largest);
    this.picture = context.getImageData(0, 0, wide, high);
    this.bare = this.picture.data.slice();
    const density = wide / width;
    const inPixels = (point) => place(point).map((part) => part * density);
    if (resized) this.covered = this.surfaces.map((surface) => new Covered(surface, inPixels, wide, high));
  }

  flat(point) {
    return [dot(this.content.view.right, point), dot(this.content.view.up, point)];
  }

  /** Where a point (right, up) [mm] lies on the canvas. */
  placed(width, height) {
    const [[left, end], [low, high]] = this.bounds;
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

  names(context, width, height) {
    const { left, right, top, bottom } = this.content.view.names;
    context.fillStyle = FAINT;
    context.textAlign = "center";
    context.fillText(top, 0.5 * (width - 46), 14);
    context.fillText(bottom, 0.5 * (width - 46), height - 6);
    for (const [text, x, turn] of [[left, 16, -1], [right, width - 66, 1]]) {
      context.save();
      context.translate(x, 0.5 * height);
      context.rotate((turn * Math.PI) / 2);
      context.fillText(text, 0, 0);
      context.restore();
    }
  }

  /** Colours with their pressures [MPa]. */
  scale(context, width, height, largest) {
    const x = width - 46;
    const tall = height - 60;
    for (let y = 0; y < tall; y++) {
      context.fillStyle = css(colourOf(this.content.colours, 1 - y / tall));
      context.fillRect(x, 30 + y, SCALE_WIDTH, 1.5);
    }
    context.strokeStyle = LINE;
    context.strokeRect(x, 30, SCALE_WIDTH, tall);
    context.fillStyle = INK;
    context.textAlign = "left";
    context.fillText("MPa", x - 2, 22);
    for (const share of [0, 0.5, 1]) context.fillText((share * largest).toFixed(largest < 10 ? 1 : 0), x + 14, 34 + tall * (1 - share));
  }
}

/** A surface without load. */
function fill(context, place, { flat, corners }) {
  context.fillStyle = context.strokeStyle = css(BONE);
  context.beginPath();
  for (let k = 0; k < corners.length; k += 3) {
    corners.subarray(k, k + 3).forEach((i, j) => context[j ? "lineTo" : "moveTo"](...place([flat[2 * i], flat[2 * i + 1]])));
  }
  context.fill();
  context.stroke();
}

function mark(context, [x, y]) {
  for (const [radius, colour] of [[5, "#fff"], [3.2, INK]]) {
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fillStyle = colour;
    context.fill();
  }
}
