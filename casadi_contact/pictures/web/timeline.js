/** The loads over the cycle, and a scrubber through it. */

import { FAINT, LINE, cleared, line, readable, write } from "./canvas.js";

const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const [LEFT, RIGHT] = [58, 8];
const FRAMES_PER_SECOND = 30;

export class Timeline {
  /** curves: [{name, values}] over the frames; moved(frame) when the scrubber moves. */
  constructor(content, curves, moved) {
    Object.assign(this, { content, curves, moved, frame: 0, playing: null });
    const parts = ["curves", "cursor", "frame", "play"].map((id) => document.getElementById(id));
    [this.canvas, this.cursor, this.scrubber, this.button] = parts;
    this.count = content.cycle.poses.length;
    this.scrubber.max = this.count - 1;
    document.getElementById("cycle").hidden = this.count < 2;
    const label = ({ name }, k) =>
      Object.assign(document.createElement("b"), { textContent: name, style: `color: ${COLOURS[k % COLOURS.length]}` });
    document.getElementById("legend").append(...curves.map(label));
    this.scrubber.addEventListener("input", () => moved(Number(this.scrubber.value)));
    this.button.addEventListener("click", () => this.play());
  }

  show(frame) {
    this.frame = frame;
    this.scrubber.value = frame;
  }

  /** Play, or pause. */
  play() {
    clearInterval(this.playing);
    this.playing = this.playing ? null : setInterval(() => this.moved((this.frame + 1) % this.count), 1000 / FRAMES_PER_SECOND);
    this.button.textContent = this.playing ? "❚❚" : "▶";
  }

  /** current: false where the pose is no longer that of the frame. */
  draw(current) {
    if (this.count < 2) return;
    const width = this.canvas.clientWidth;
    if (width !== this.width) this.drawCurves();
    this.width = width;
    const x = LEFT + ((width - LEFT - RIGHT) * this.frame) / (this.count - 1);
    this.cursor.style.transform = `translateX(${x}px)`;
    this.cursor.style.opacity = current ? 0.9 : 0.25;
  }

  drawCurves() {
    const { context, width, height } = cleared(this.canvas);
    const values = this.curves.flatMap(({ values }) => values).concat(0);
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const x = (frame) => LEFT + ((width - LEFT - RIGHT) * frame) / (this.count - 1);
    const y = (value) => 8 + ((height - 16) * (high - value)) / (high - low || 1);
    write(context, FAINT, [low, high].map((value) => [`${readable(value)} N`, "right", LEFT - 8, y(value) + 4]));
    context.strokeStyle = LINE;
    line(context, [[LEFT, y(0)], [width - RIGHT, y(0)]]);
    this.curves.forEach(({ values: of }, k) => {
      Object.assign(context, { strokeStyle: COLOURS[k % COLOURS.length], lineWidth: 1.5 });
      line(context, of.map((value, frame) => [x(frame), y(value)]));
    });
  }
}
