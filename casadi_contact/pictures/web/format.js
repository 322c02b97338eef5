/** Numbers as people read them. Inside the page as in the library: mm, rad, N, N·mm, MPa. */

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
