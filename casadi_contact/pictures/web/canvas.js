/** Canvases that are as sharp as the screen, colours, and numbers as people read them. */

export const INK = "#1d2329";
export const FAINT = "#6b747d";
export const LINE = "#dfe3e6";
export const ACCENT = "#0072b2";
export const BONE = [0.87, 0.86, 0.83];

/** A canvas given as many pixels as its place on the page has; that place's size [CSS pixel], and how many pixels one is. */
export function sharpened(canvas) {
  const density = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const [wide, high] = [Math.round(width * density), Math.round(height * density)];
  if (canvas.width !== wide || canvas.height !== high) Object.assign(canvas, { width: wide, height: high });
  return { width, height, density };
}

/** The context of a canvas cleared to its size on the page, in CSS pixels; and that size. */
export function cleared(canvas) {
  const { width, height, density } = sharpened(canvas);
  const context = canvas.getContext("2d");
  context.setTransform(density, 0, 0, density, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = "11px system-ui, 'DejaVu Sans', sans-serif";
  return { context, width, height };
}

/** Texts [text, how it is aligned, x, y] in one colour. */
export function write(context, colour, texts) {
  context.fillStyle = colour;
  for (const [text, align, x, y] of texts) {
    context.textAlign = align;
    context.fillText(text, x, y);
  }
}

/** The path through points, drawn in the context's style. */
export function line(context, points) {
  context.beginPath();
  points.forEach((point, i) => context[i ? "lineTo" : "moveTo"](...point));
  context.stroke();
}

export const css = ([r, g, b]) => `rgb(${Math.round(255 * r)} ${Math.round(255 * g)} ${Math.round(255 * b)})`;

/** A number with about three significant digits, minus sign included; "–" for what is not a number. */
export function readable(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const digits = size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3;
  const text = size < 1e6 ? value.toFixed(digits) : value.toExponential(1);
  return Number(text) === 0 ? "0" : text.replace("-", "−");
}

/** Let an element say a text; the same text again costs nothing. */
export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
