"""A choice as one small table for the terminal."""

from __future__ import annotations

import math

from rich.table import Table

from casadi_contact.benchmark.choose import Choice


def choice_table(choice: Choice) -> Table:
    """The chosen model and the next better one: time per pose, how it was found, RMS errors on unseen walking."""
    table = Table(title=f"Cheapest model for {', '.join(choice.loads)} within tolerance, errors on unseen walking")
    for column in ("", "model", "time [µs]", "time is", "RMS force [N]", "RMS torque [N·mm]"):
        table.add_column(column, justify="right" if "[" in column else "left")
    for what, offer in (("chosen", choice.model), ("next better", choice.better)):
        if offer is None:
            table.add_row(what, "none measured is more accurate")
            continue
        errors = ("-" if math.isnan(rms) else f"{rms:.3g}" for rms in (offer.force_rms_n, offer.torque_rms_nmm))
        table.add_row(what, offer.name, f"{offer.time_us:.3g}", offer.timing, *errors)
    return table
