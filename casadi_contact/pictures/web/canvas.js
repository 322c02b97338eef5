/** Canvases that are as sharp as the screen, and colours. */

export const INK = "#1d2329";
export const FAINT = "#6b747d";
export const LINE = "#dfe3e6";
export const ACCENT = "#0072b2";
export const BONE = [0.87, 0.86, 0.83];

let sizes = new WeakMap(); // asking for one makes the browser lay out the page
window.addEventListener("resize", () => (sizes = new WeakMap()));

/** Width and height of a canvas on the page [CSS pixel]. */
export function sizeOf(canvas) {
  if (!sizes.has(canvas)) sizes.set(canvas, [canvas.clientWidth, canvas.clientHeight]);
  return sizes.get(canvas);
}

/** The context of a canvas cleared to its size on the page, in CSS pixels; and that size. */
export function cleared(canvas) {
  const density = window.devicePixelRatio || 1;
  const [width, height] = sizeOf(canvas);
  const [wide, high] = [Math.round(width * density), Math.round(height * density)];
  if (canvas.width !== wide || canvas.height !== high) Object.assign(canvas, { width: wide, height: high });
  const context = canvas.getContext("2d");
  context.setTransform(density, 0, 0, density, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = "11px system-ui, 'DejaVu Sans', sans-serif";
  return { context, width, height };
}

export const css = ([r, g, b]) => `rgb(${Math.round(255 * r)} ${Math.round(255 * g)} ${Math.round(255 * b)})`;
