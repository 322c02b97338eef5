/** Loads, expected errors, gaps, and the light of validity. */

import { readable, say } from "./format.js";

const VALID = 0.9;
export const LEARNED = 0.5;

export class LoadsPanel {
  constructor(content, hasSurrogate) {
    this.content = content;
    const columns = hasSurrogate ? ["", "contact model", "surrogate", "expected error"] : ["", "contact model"];
    document.getElementById("head").innerHTML = `<tr>${columns.map((text) => `<th>${text}</th>`).join("")}</tr>`;
    this.rows = content.loads.map(({ name, unit }) => {
      const row = document.getElementById("rows").insertRow();
      row.innerHTML = `<td>${name} <small>${unit}</small></td>` + "<td></td>".repeat(columns.length - 1);
      return row;
    });
    this.gaps = content.patches.map(({ title }) => {
      const row = document.getElementById("gaps").insertRow();
      row.insertCell().textContent = title;
      return row.insertCell();
    });
  }

  /** state: {contact: loads, surrogate: loads or null, errors, validity, gaps: mm or null in contact}. */
  draw({ contact, surrogate, errors, validity, gaps }) {
    this.rows.forEach((row, k) => {
      say(row.cells[1], readable(contact[k]));
      if (!surrogate) return;
      say(row.cells[2], readable(surrogate[k]));
      say(row.cells[3], `± ${readable(errors[k])}`);
    });
    gaps.forEach((gap, patch) => say(this.gaps[patch], gap === null ? "in contact" : `${readable(gap)} mm`));
    const light = document.getElementById("validity");
    const known = Number.isFinite(validity);
    light.dataset.state = !known ? "unknown" : validity >= VALID ? "good" : validity >= LEARNED ? "doubtful" : "outside";
    const word = { good: "learned", doubtful: "at the edge of what was learned", outside: "outside what was learned" };
    say(light.querySelector("span"), known ? `validity ${validity.toFixed(2)}: ${word[light.dataset.state]}` : "no surrogate: the contact model alone");
  }
}
