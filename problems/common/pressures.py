"""Contact areas, pressures and penetrations of a solution as columns of files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from casadi_contact.contact.pressures import PressureSummary
from casadi_contact.core.conventions import Array
from casadi_contact.core.quantities import quantity
from casadi_contact.scenes.opensim.mapping import loads_table
from casadi_contact.scenes.opensim.table import Table


def pressure_columns(pressed: PressureSummary, patch_names: Sequence[str]) -> dict[str, Array]:
    """contact_area_med_mm2, peak_pressure_med_MPa and so on, each (n,); a centre of pressure is NaN without contact."""
    return {quantity(name).column: values for name, values in pressed.named(patch_names).items()}


def pressures_table(time_s: Array, pressed: PressureSummary, patch_names: Sequence[str], name: str) -> Table:
    """The same in OpenSim's units (m², Pa, m), whose files have no NaN: a centre of pressure that some frame lacks is
    left out, and the header says so."""
    columns = pressed.named(patch_names)
    whole = {key: values for key, values in columns.items() if np.isfinite(values).all()}
    table = loads_table(time_s, np.column_stack(list(whole.values())), list(whole), name)
    missing = [key for key in columns if key not in whole]
    notes = (f"left out, without contact in some frame: {', '.join(missing)}",) if missing else ()
    return replace(table, notes=notes)
