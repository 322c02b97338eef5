"""A surrogate's reach as a picture: the sampled range of every pose parameter and load."""

from __future__ import annotations

from typing import Any

from casadi_contact.pictures.page import new_page
from casadi_contact.surrogate.base import Surrogate


def draw_reach(surrogate: Surrogate) -> Any:
    """A panel for each unit (mm, °, N, N·mm), a bar from low to high for each quantity that the file records."""
    rows = surrogate.info().reach
    units = list(dict.fromkeys(unit for *_, unit in rows))
    figure = new_page(2.8 * max(len(units), 1), 2.2)
    share = surrogate.record.get("valid_share")
    said = "" if share is None else f"; {100.0 * share:.1f} % of its held-back poses called valid"
    figure.suptitle(f"{surrogate.scene.name}: sampled ranges{said}", fontsize=9)
    for unit, axis in zip(units, figure.subplots(1, max(len(units), 1), squeeze=False)[0], strict=False):
        of_unit = [row for row in rows if row[3] == unit]
        for height, (_, low, high, _) in enumerate(of_unit):
            axis.barh(height, high - low, left=low, height=0.6, color="#0072b2", alpha=0.7)
            axis.plot([low, high], [height, height], "|", color="#222", ms=9)
        axis.set_yticks(range(len(of_unit)), [name for name, *_ in of_unit], fontsize=8)
        axis.use_sticky_edges = False
        axis.margins(x=0.08)
        axis.invert_yaxis()
        axis.axvline(0.0, color="#888", lw=0.6)
        axis.grid(alpha=0.25, axis="x", lw=0.5)
        axis.tick_params(axis="x", labelsize=7)
        axis.set_xlabel(unit, fontsize=8)
    return figure
