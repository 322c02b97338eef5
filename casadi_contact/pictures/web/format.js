/** Numbers as people read them. Inside the page as in the library: mm, rad, N, N·mm, MPa. */

export const DEGREES_PER_RADIAN = 180 / Math.PI;

/** A number with about three significant digits, minus sign included; "–" for what is not a number. */
export function readable(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const digits = size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3;
  const text = value.toFixed(digits);
  return Number(text) === 0 ? "0" : text.replace("-", "−");
}

/** Value of a pose parameter as its slider shows it: mm, or degrees for an angle. */
export function shown(parameter, value) {
  return parameter.unit === "rad" ? value * DEGREES_PER_RADIAN : value;
}

/** The other way round. */
export function stored(parameter, value) {
  return parameter.unit === "rad" ? value / DEGREES_PER_RADIAN : value;
}

/** Let an element say a text; the same text again costs nothing. */
export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
