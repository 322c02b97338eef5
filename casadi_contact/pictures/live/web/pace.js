/** How finely to draw: in full at rest, and while things move as finely as the machine keeps up with. */

const DENSITIES = [2, 1.5, 1, 0.75]; // samples to a dot of the screen, each way: more than one smooth the edges
const MOST = 3; // to a CSS pixel, on any screen
const SLOW_MS = 30; // a frame that takes longer is a slow one,
const PATIENCE = 3; // and so many more of these than of quick ones make drawing coarser
const REST_FRAMES = 8; // of the page without a new picture

export class Pace {
  /** drawWith(density, inFull) draws; this decides with how many samples to a CSS pixel, each way, and whether in full. */
  constructor(drawWith) {
    Object.assign(this, { drawWith, level: 0, slow: 0, since: 0, watch: null });
  }

  drawAt(level) {
    this.drawWith(Math.min(DENSITIES[level] * (window.devicePixelRatio || 1), MOST), level === 0);
  }

  draw() {
    this.drawAt(this.level);
    this.drawn = document.timeline.currentTime;
    this.since = 0;
    this.watch ??= requestAnimationFrame((now) => this.frame(now));
  }

  /** The page's next frame: how long did the picture take, and is it at rest? */
  frame(now) {
    this.watch = null;
    if (now > this.drawn && this.since++ === 0) this.took(now - this.drawn);
    if (this.since < REST_FRAMES) this.watch = requestAnimationFrame((next) => this.frame(next));
    else this.rest();
  }

  /** Coarser for as long as it moves: a change to and fro would be seen. */
  took(milliseconds) {
    this.slow = Math.max(0, this.slow + (milliseconds > SLOW_MS ? 1 : -1));
    if (this.slow < PATIENCE) return;
    this.slow = 0;
    this.level = Math.min(this.level + 1, DENSITIES.length - 1);
  }

  /** The next movement begins a step finer than this one ended: something else may have made it slow. */
  rest() {
    if (this.level > 0) this.drawAt(0);
    this.level = Math.max(0, this.level - 1);
    this.slow = 0;
  }
}
