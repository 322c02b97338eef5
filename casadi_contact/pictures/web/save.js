/** What is taken away from the page: tables of the cycle. */

/** Poses and loads of the cycle, in the library's units: the poses are what cc's read_poses reads. */
export function csvOf(content, loads) {
  const names = ["time_s", ...content.pose.map(({ name }) => name), ...content.loads.map(({ column }) => column)];
  const rows = content.cycle.poses.map((pose, frame) => [content.cycle.time[frame], ...pose, ...loads[frame]]);
  return `${[names, ...rows].map((row) => row.join(",")).join("\n")}\n`;
}

/** Poses and loads as OpenSim has them: m, rad, N, N·m. */
export function stoOf(content, loads) {
  const unit = ({ unit: of }) => (of === "mm" || of === "N·mm" ? 1000 : 1);
  const columns = [...content.pose, ...content.loads];
  const rows = content.cycle.poses.map((pose, frame) =>
    [content.cycle.time[frame], ...[...pose, ...loads[frame]].map((value, k) => value / unit(columns[k]))].join("\t"),
  );
  const head = [content.scene, "version=1", `nRows=${rows.length}`, `nColumns=${columns.length + 1}`, "inDegrees=no"];
  const labels = ["time", ...columns.map(({ name }) => name)].join("\t");
  return `${[...head, "endheader", labels, ...rows].join("\n")}\n`;
}

export function download(name, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/plain" }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
