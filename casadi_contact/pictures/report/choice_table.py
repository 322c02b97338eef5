"""A choice as one small table for the terminal."""

from __future__ import annotations

from rich.table import Table

from casadi_contact.core.quantities import FORCE, TORQUE, of_kind
from casadi_contact.workflow.benchmark.choose import Choice


def choice_table(choice: Choice) -> Table:
    """The chosen model and the next better one: time per pose, how it was found, RMS errors on unseen poses of
    the scene's motion."""
    table = Table(
        title=f"Cheapest model for {', '.join(choice.loads)} within tolerance, errors on unseen poses of its motion"
    )
    errors = [("force_rms_n", FORCE), ("torque_rms_nmm", TORQUE)]
    asked = [(error, kind) for error, kind in errors if of_kind(choice.loads, kind)]
    for column in ("", "model", "time [µs]", "time is", *(f"RMS {kind.name} [{kind.unit}]" for _, kind in asked)):
        table.add_column(column, justify="right" if "[" in column else "left")
    for what, offer in (("chosen", choice.model), ("next better", choice.better)):
        if offer is None:
            table.add_row(what, "none measured is more accurate")
            continue
        cells = (f"{getattr(offer, error):.3g}" for error, _ in asked)
        table.add_row(what, offer.name, f"{offer.time_us:.3g}", offer.timing, *cells)
    return table
