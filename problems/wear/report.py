"""What wear says: volumes and depths of each patch, a CSV of all elements, a JSON summary and a map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from casadi_contact.contact import ElasticFoundation
from casadi_contact.motion.columns import write_columns
from casadi_contact.page import new_page, save_page
from casadi_contact.show import view_of
from casadi_contact.show.figure import name_axes
from casadi_contact.terminal import PlainConsole
from problems.common.records import write_summary
from problems.wear.problem import CYCLES, PatchWear, volume_mm3

_DIGITS = 5
_TALLEST = 2.0  # height of a panel over its width


def report(
    model: ElasticFoundation,
    wear: Sequence[PatchWear],
    coarser: Mapping[str, float],
    wear_factor: float,
    seconds: float,
    out: Path,
) -> None:
    """Print the table and write wear.csv, .json and .png in the folder out; all for a million cycles.

    coarser: volume of one cycle [mm³] with fewer frames or elements, by what is coarser.
    """
    console = PlainConsole()
    total = volume_mm3(wear)
    title = f"Wear of {model.scene.name} in a million cycles, k = {wear_factor:g} mm³/(N·m), {model.label}"
    console.print(_table(wear, title))
    console.print(f"{CYCLES * total:.4g} mm³ in a million cycles, {seconds:.1f} s", highlight=False)
    for what, volume in coarser.items():
        console.print(f"{what}: {100.0 * (volume / total - 1.0):+.2g} %" if total else f"{what}: none", highlight=False)
    write_columns(
        out / "wear.csv",
        {
            "patch": [patch.patch for patch in wear for _ in patch.areas_mm2],
            **{f"{axis}_mm": np.concatenate([p.centres_mm[:, i] for p in wear]) for i, axis in enumerate("xyz")},
            "area_mm2": np.concatenate([patch.areas_mm2 for patch in wear]),
            "depth_mm_per_million": CYCLES * np.concatenate([patch.depth_mm for patch in wear]),
            "sliding_mm_per_cycle": np.concatenate([patch.sliding_mm for patch in wear]),
        },
        digits=_DIGITS,
    )
    summary: dict[str, Any] = {
        "model": repr(model),
        "wear_factor_mm3_per_nm": wear_factor,
        "cycles": CYCLES,
        "volume_mm3": CYCLES * total,
        "coarser_volume_mm3": {what: CYCLES * volume for what, volume in coarser.items()},
        "patches": {
            patch.patch: {"volume_mm3": CYCLES * patch.volume_mm3, "deepest_mm": CYCLES * float(patch.depth_mm.max())}
            for patch in wear
        },
        "seconds": seconds,
    }
    write_summary(out / "wear.json", summary)
    draw(model, wear, out / "wear.png")
    console.print(f"results in {out}", highlight=False)


def _table(wear: Sequence[PatchWear], title: str) -> Table:
    """Volume, greatest depth, way slid there and worn area of each patch."""
    table = Table(title=title)
    for name in ("patch", "volume (mm³)", "deepest (mm)", "slid there in a cycle (mm)", "worn area (mm²)"):
        table.add_column(name, justify="left" if name == "patch" else "right")
    for patch in wear:
        at = int(patch.depth_mm.argmax())
        table.add_row(
            patch.patch,
            f"{CYCLES * patch.volume_mm3:.3g}",
            f"{CYCLES * patch.depth_mm[at]:.3g}",
            f"{patch.sliding_mm[at]:.3g}",
            f"{patch.areas_mm2[patch.depth_mm > 0.0].sum():.3g}",
        )
    return table


def draw(model: ElasticFoundation, wear: Sequence[PatchWear], path: Path) -> None:
    """Depths after a million cycles and the way slid under pressure, seen as the moving body presses, as a PNG."""
    view, centres_mm = view_of(model), np.concatenate([patch.centres_mm for patch in wear])
    right, up = view.right.of(centres_mm), view.up.of(centres_mm)
    page = new_page(10.0, 1.2 + 3.7 * min(np.ptp(up) / np.ptp(right), _TALLEST))  # panels at one scale fill it
    panels = page.subplots(1, 2, sharex=True, sharey=True)
    depth = 1e3 * CYCLES * np.concatenate([patch.depth_mm for patch in wear])
    sliding = np.concatenate([patch.sliding_mm for patch in wear])
    for axis, values, label in zip(
        panels, (depth, sliding), ("worn in a million cycles [µm]", "slid under pressure in a cycle [mm]"), strict=True
    ):
        image = axis.scatter(right, up, c=np.where(values > 0.0, values, np.nan), s=1.0, marker="s", cmap="viridis")
        axis.plot(right[values <= 0.0][::7], up[values <= 0.0][::7], ",", color="0.85", zorder=0)
        page.colorbar(image, ax=axis, label=label, shrink=0.95)
        name_axes(axis, view)
        axis.label_outer()
    volumes = ", ".join(f"{patch.patch} {CYCLES * patch.volume_mm3:.3g}" for patch in wear)
    page.suptitle(f"Archard wear after a million cycles: {volumes} mm³")
    save_page(page, path, dots_per_inch=90)
