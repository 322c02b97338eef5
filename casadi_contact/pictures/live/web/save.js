/** What is taken away from the page: tables of the cycle, a picture, and Python. */

import { sizeOf } from "./canvas.js";

const MM_PER_M = 1000;

/** Poses and loads of the cycle, in the library's units: the poses are what cc's read_poses reads. */
export function csvOf(content, loads) {
  const names = ["time_s", ...content.pose.map(({ name }) => name), ...content.loads.map(({ column }) => column)];
  const rows = content.cycle.poses.map((pose, frame) => [content.cycle.time[frame], ...pose, ...loads[frame]]);
  return `${[names, ...rows].map((row) => row.join(",")).join("\n")}\n`;
}

/** Poses and loads as OpenSim has them: m, rad, N, N·m. */
export function stoOf(content, loads) {
  const unit = ({ unit: of }) => (of === "mm" || of === "N·mm" ? MM_PER_M : 1);
  const columns = [...content.pose, ...content.loads];
  const rows = content.cycle.poses.map((pose, frame) =>
    [content.cycle.time[frame], ...[...pose, ...loads[frame]].map((value, k) => value / unit(columns[k]))].join("\t"),
  );
  const head = [content.scene, "version=1", `nRows=${rows.length}`, `nColumns=${columns.length + 1}`, "inDegrees=no"];
  const labels = ["time", ...columns.map(({ name }) => name)].join("\t");
  return `${[...head, "endheader", labels, ...rows].join("\n")}\n`;
}

/** What holds column k of a pose that does not settle, in Python: the start, or what the scene locks or ties it to. */
function heldAt(content, k) {
  const row = content.space?.matrix[k];
  if (!row || row[k] === 1) return `start[${k}]`;
  const to = row.findIndex((slope) => slope !== 0);
  return to < 0 ? `${content.space.offset[k]}` : `${content.space.offset[k]} + ${row[to]} * pose[${to}]`;
}

/** Python of an optimisation that begins at the pose and asks for its loads. */
export function optiOf(content, pose, wanted) {
  const { free, loads } = content.settle;
  const fixed = content.pose.map(({ name }, k) => [name, k]).filter(([name]) => !free.includes(name));
  const all = content.modelLoads;
  return [
    "import casadi as ca",
    "import casadi_contact as cc",
    "",
    `model = ${content.python}`,
    "opti = ca.Opti()",
    "pose = opti.variable(6)  # tx, ty, tz [mm], rx, ry, rz [rad]",
    `start = [${Array.from(pose).join(", ")}]`,
    "opti.set_initial(pose, start)",
    "loads = model.function()(pose)",
    ...loads.map((name, i) => `opti.subject_to(loads[${all.indexOf(name)}] == ${wanted[i]})  # ${name}`),
    ...fixed.map(([name, k]) => `opti.subject_to(pose[${k}] == ${heldAt(content, k)})  # ${name}`),
    'opti.solver("ipopt")',
    "solution = opti.solve()",
    "print(solution.value(pose), solution.value(loads))",
    "",
  ].join("\n");
}

/** Several canvases, one beside or below the other, as one picture on white, as large as on the screen. */
export function pictureOf([top, ...below]) {
  const density = window.devicePixelRatio || 1;
  const sizes = new Map([top, ...below].map((canvas) => [canvas, sizeOf(canvas).map((side) => Math.round(side * density))]));
  const [wide, high] = sizes.get(top);
  const picture = document.createElement("canvas");
  picture.width = Math.max(wide, below.reduce((sum, canvas) => sum + sizes.get(canvas)[0], 0));
  picture.height = high + Math.max(...below.map((canvas) => sizes.get(canvas)[1]));
  const context = picture.getContext("2d");
  context.fillStyle = "#fff";
  context.fillRect(0, 0, picture.width, picture.height);
  context.drawImage(top, 0, 0, wide, high);
  let x = 0;
  for (const canvas of below) {
    context.drawImage(canvas, x, high, ...sizes.get(canvas));
    x += sizes.get(canvas)[0];
  }
  return new Promise((done) => picture.toBlob(done, "image/png"));
}

export function download(name, blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
