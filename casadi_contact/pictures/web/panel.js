/** Sliders of the pose, presets, typed loads to settle under; loads, expected errors, gaps, the light of validity. */

import { readable, say } from "./canvas.js";

const element = (tag, properties = {}, ...children) => {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
};

/** Six sliders; changed(pose) is called when one moves. show(pose) moves them. */
export function sliders(place, content, changed) {
  let pose = [];
  const rows = content.pose.map((parameter, k) => {
    const [low, high] = parameter.range.map((bound) => parameter.factor * bound);
    const step = (high - low) / 1000;
    const slide = element("input", { type: "range", min: low, max: high, step, ariaLabel: parameter.name });
    const number = element("input", { type: "number", min: low, max: high, step: "any", id: parameter.name });
    const take = (text) => {
      const value = Number(text);
      if (text === "" || !Number.isFinite(value)) return;
      pose = pose.with(k, Math.min(Math.max(value, low), high) / parameter.factor);
      changed(pose);
    };
    slide.oninput = number.onchange = ({ target }) => take(target.value);
    const ends = element("div", { className: "ends" }, ...parameter.ends.map((end, i) =>
      element("span", { textContent: i ? `${end} ${readable(high)}` : `${readable(low)} ${end}` })));
    place.append(element("div", { className: "slider" },
      element("label", { htmlFor: parameter.name }, parameter.label, element("small", { textContent: ` ${parameter.name}` })), number,
      element("span", { className: "unit", textContent: parameter.unit }), slide, ends));
    return { parameter, slide, number };
  });
  return (next) => {
    pose = Array.from(next);
    rows.forEach(({ parameter, slide, number }, k) => {
      const value = parameter.factor * pose[k];
      slide.value = value;
      if (document.activeElement !== number) number.value = value.toFixed(3);
    });
  };
}

/** A button for each preset, a frame of the cycle; chosen(frame). */
export function presets(place, content, chosen) {
  const button = ([name, frame]) => element("button", { type: "button", textContent: name, onclick: () => chosen(frame) });
  place.append(...Object.entries(content.presets).map(button));
}

/** Fields for the wanted loads; wanted(values) when the form is sent. */
export function targets(form, content, wanted) {
  const { free, loads, start } = content.settle;
  form.hidden = !free.length;
  form.querySelector("#free").textContent = `moves ${free.join(", ")}`;
  const fields = loads.map((name, i) => {
    const { unit } = content.loads.find((load) => load.name === name);
    const field = element("input", { type: "number", step: "any", value: start[i].toFixed(1), id: `target-${name}` });
    form.querySelector("#targets").append(element("div", { className: "target" },
      element("label", { textContent: name, htmlFor: field.id }), field, element("span", { textContent: unit })));
    return field;
  });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    wanted(fields.map((field) => Number(field.value)));
  });
}

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
