/** Loads in figures and bars, expected errors, gaps, and the light of validity. */

import { ACCENT, FAINT, LINE, SECOND, cleared } from "./canvas.js";
import { readable, say } from "./format.js";

const VALID = 0.9;
const LEARNED = 0.5;

export class LoadsPanel {
  constructor(content, hasSurrogate) {
    this.content = content;
    const columns = hasSurrogate ? ["", "contact model", "surrogate", "expected error"] : ["", "contact model"];
    document.getElementById("head").innerHTML = `<tr>${columns.map((text) => `<th>${text}</th>`).join("")}</tr>`;
    if (hasSurrogate) document.getElementById("barred").textContent = "surrogate";
    document.getElementById("beside").hidden = !hasSurrogate;
    this.rows = content.loads.map(({ name, unit }) => {
      const row = document.getElementById("rows").insertRow();
      row.innerHTML = `<td>${name} <small>${unit}</small></td>` + "<td></td>".repeat(columns.length - 1);
      const bar = document.getElementById("rows").insertRow().insertCell();
      bar.colSpan = columns.length;
      bar.className = "bar";
      bar.append(document.createElement("canvas"));
      return { row, bar: bar.firstChild };
    });
    this.gaps = content.patches.map((patch) => {
      const row = document.getElementById("gaps").insertRow();
      row.innerHTML = `<td>${content.patches.length > 1 ? patch.title : "surfaces"}</td><td></td>`;
      return row.cells[1];
    });
  }

  /** state: {contact: loads, surrogate: loads or null, errors, validity, gaps: mm or null in contact}; largest: of each
   * load over the cycle, where its bar ends. */
  draw({ contact, surrogate, errors, validity, gaps }, largest) {
    this.rows.forEach(({ row, bar }, k) => {
      say(row.cells[1], readable(contact[k]));
      if (surrogate) {
        say(row.cells[2], readable(surrogate[k]));
        say(row.cells[3], `± ${readable(errors[k])}`);
      }
      drawBar(bar, contact[k], surrogate?.[k], errors?.[k], largest[k]);
    });
    gaps.forEach((gap, patch) => {
      say(this.gaps[patch], gap === null ? "in contact" : `${readable(gap)} mm`);
    });
    showValidity(validity);
  }
}

/** Zero in the middle; the surrogate a bar with its expected error and the contact model a line, or, alone, the bar. */
function drawBar(canvas, contact, surrogate, error, largest) {
  const { context, width, height } = cleared(canvas);
  const x = (value) => 0.5 * width * (1 + Math.min(Math.max(value / largest, -1), 1));
  context.fillStyle = LINE;
  context.fillRect(0, 0.5 * height, width, 1);
  const value = surrogate ?? contact;
  context.fillStyle = ACCENT;
  context.globalAlpha = 0.75;
  context.fillRect(Math.min(x(0), x(value)), 2, Math.abs(x(value) - x(0)), height - 4);
  context.globalAlpha = 1;
  if (Number.isFinite(error)) {
    context.fillStyle = FAINT;
    const [low, high] = [x(value - error), x(value + error)];
    context.fillRect(low, 0.5 * height - 0.5, Math.max(high - low, 1), 1.5);
    for (const end of [low, high]) context.fillRect(end - 0.5, 1, 1, height - 2);
  }
  if (surrogate === undefined) return;
  context.fillStyle = SECOND;
  context.fillRect(x(contact) - 0.75, 0, 1.5, height);
}

function showValidity(validity) {
  const light = document.getElementById("validity");
  const known = validity !== null && Number.isFinite(validity);
  light.dataset.state = !known ? "unknown" : validity >= VALID ? "good" : validity >= LEARNED ? "doubtful" : "outside";
  const word = { good: "learned", doubtful: "at the edge of what was learned", outside: "outside what was learned" };
  const text = known ? `validity ${validity.toFixed(2)}: ${word[light.dataset.state]}` : "no surrogate: the contact model alone";
  say(light.querySelector("span"), text);
}
