/** The page: one pose, and everything that follows from it. */

import { readable, say } from "./canvas.js";
import { loadModels, unpack } from "./kernel.js";
import { dot } from "./linear.js";
import { LEARNED, LoadsPanel, presets, sliders, targets } from "./panel.js";
import { csvOf, download, stoOf } from "./save.js";
import { Bodies } from "./scene.js";
import { settle } from "./settle.js";
import { Timeline } from "./timeline.js";
import { PressureMap, Section } from "./views.js";

const byId = (id) => document.getElementById(id);

/** Everything that a pose gives, except the pressures at points. */
function evaluated(models, content, pose) {
  const { contact, surrogate } = models;
  const confidence = surrogate?.confidence(pose);
  const inOrder = (values) =>
    values && content.loads.map(({ name }) => values[content.surrogateLoads.indexOf(name)] ?? NaN);
  return {
    contacts: contact.contact(pose),
    contact: contact.loads(pose),
    surrogate: inOrder(surrogate?.loads(pose)),
    errors: inOrder(confidence?.errors),
    validity: confidence?.validity,
    gaps: Array.from(contact.both("roots", pose).values, (root) => (root > 0 ? null : -root / content.gapSlope)),
  };
}

class Page {
  /** What the content alone shows, before anything is computed. */
  constructor(content) {
    this.content = content;
    this.panel = new LoadsPanel(content, Boolean(content.surrogateLoads));
    this.pose = content.cycle.poses[content.presets.stance];
    this.moveSliders = sliders(byId("sliders"), content, (pose) => this.go(pose));
    this.moveSliders(this.pose);
    presets(byId("presets"), content, (frame) => this.at(frame));
    targets(byId("settle"), content, (wanted) => this.settle(wanted));
  }

  begin(models, surfaces, behind, moving) {
    const { content } = this;
    this.models = models;
    models.contact.names = content.loads.map(({ name }) => name);
    if (models.surrogate) models.surrogate.names = content.surrogateLoads;
    this.model = models.surrogate ?? models.contact;
    this.frames = content.cycle.poses.map((pose) => evaluated(models, content, pose));
    this.frameLoads = this.frames.map(({ contact, surrogate }) => Array.from(surrogate ?? contact));
    this.trail = content.patches.map((_, patch) => this.frames.map(({ contacts }) => contacts[patch].centre));
    this.peak = Math.max(1, ...this.frames.flatMap(({ contacts }) => contacts.map(({ peak: of }) => of)));
    const gl = byId("scene").getContext("webgl2");
    if (gl) this.bodies = new Bodies(gl, content, surfaces, behind, moving);
    else byId("scene").parentElement.append(trouble("The bodies are not drawn: got no WebGL 2, expected a browser that allows it; the numbers hold all the same, and another browser, or hardware acceleration in this one's settings, draws them."));
    this.map = new PressureMap(byId("map"), content, surfaces);
    this.sections = ["up", "right"].map((across) => new Section(byId(`section-${across}`), content, across, surfaces, behind, moving));
    const valuesOf = (name) => this.frameLoads.map((row) => row[models.contact.names.indexOf(name)]);
    const curves = content.sensitive.map((name) => ({ name, values: valuesOf(name) }));
    this.timeline = new Timeline(content, curves, (frame) => this.at(frame));
    this.saving();
    window.addEventListener("resize", () => this.draw());
    this.at(content.presets.stance);
    document.body.inert = false;
  }

  at(frame) {
    this.timeline.show(frame);
    this.go(this.content.cycle.poses[frame], frame);
  }

  /** frame: of the cycle, where the pose is one of it. */
  go(pose, frame = null) {
    this.pose = Array.from(pose);
    this.frame = frame;
    byId("settled").textContent = ""; // of the pose before
    this.state = evaluated(this.models, this.content, this.pose);
    this.later ??= requestAnimationFrame(() => {
      this.later = null;
      this.draw();
    });
  }

  draw() {
    const { contacts } = this.state;
    const pressures = contacts.map((_, patch) => this.models.contact.pressures(this.pose, patch));
    const largest = Math.max(this.peak, ...contacts.map(({ peak }) => peak));
    this.bodies?.show(this.pose, pressures, largest);
    this.moveSliders(this.pose);
    this.map.draw(pressures, largest, contacts, this.trail);
    const { centre } = contacts.reduce((most, each) => (each.force > most.force ? each : most));
    for (const section of this.sections) {
      const [name, sign] = this.content.view.planes[section.across];
      const at = dot(this.content.view[section.across], centre ?? this.content.view.target);
      section.draw(this.pose, at);
      say(byId(`cut-${section.across}`), `section at ${name} = ${readable(sign * at)} mm`);
    }
    const figures = contacts.map(({ area, peak }, patch) =>
      `${this.content.patches[patch].title}: ${area > 0 ? `peak ${readable(peak)} MPa, ${readable(area)} mm²` : "no contact"}`);
    say(byId("figures"), figures.join("\n"));
    this.panel.draw(this.state);
    this.timeline.draw(this.frame !== null);
  }

  settle(wanted) {
    const { free, loads } = this.content.settle;
    const columns = free.map((name) => this.content.pose.findIndex((parameter) => parameter.name === name));
    const found = settle(this.model, this.content, this.pose, columns, { names: loads, wanted });
    this.go(found.pose);
    byId("settled").textContent = found.converged
      ? `settled in ${found.steps} steps${this.state.validity < LEARNED ? ", outside what was learned" : ""}`
      : `no equilibrium near here: off by ${readable(found.misfit)} N`;
  }

  saving() {
    const { content, frameLoads } = this;
    byId("csv").onclick = () => download(`${content.scene}.csv`, csvOf(content, frameLoads));
    byId("sto").onclick = () => download(`${content.scene}.sto`, stoOf(content, frameLoads));
  }
}

/** A paragraph that says what is wrong. */
function trouble(text) {
  const paragraph = Object.assign(document.createElement("p"), { className: "trouble", textContent: text });
  paragraph.setAttribute("role", "alert");
  return paragraph;
}

/** In place of controls that would do nothing. */
function giveUp(error) {
  console.error(error);
  document.querySelector("main").replaceWith(trouble(`Nothing can be computed here: got “${error}”, expected an undamaged file in a browser with WebAssembly and its vectors (SIMD); open it in a current Chrome, Edge, Firefox or Safari, or write it anew by casadi-contact page.`));
  byId("cycle").remove();
  document.body.inert = false;
}

async function begin() {
  const arrays = await unpack(content.arrays, byId("arrays").textContent);
  document.head.append(Object.assign(document.createElement("script"), { textContent: new TextDecoder().decode(arrays.library) }));
  const body = (name) => Object.fromEntries(["points", "normals", "corners", "places"].map((of) => [of, arrays[`${name}_${of}`]]));
  const surfaces = content.patches.map(({ name }) => body(`patch_${name}`));
  const models = await loadModels(arrays.kernel, content.loads.length, content.surrogateLoads?.length, surfaces);
  page.begin(models, surfaces, body("behind"), body("moving"));
  window.joint = page;
}

const content = JSON.parse(byId("content").textContent);
const page = new Page(content);
requestAnimationFrame(() => setTimeout(() => begin().catch(giveUp))); // the page is seen before it computes
