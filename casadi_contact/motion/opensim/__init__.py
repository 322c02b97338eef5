"""OpenSim's motion and storage files, and how their columns become poses and loads."""

from casadi_contact.motion.opensim.mapping import (
    ColumnMap,
    loads_table,
    mapped_curves,
    poses_table,
    renamed_table,
)
from casadi_contact.motion.opensim.table import TIME, Table, read_opensim_table, write_table

__all__ = [
    "TIME",
    "ColumnMap",
    "Table",
    "loads_table",
    "mapped_curves",
    "poses_table",
    "read_opensim_table",
    "renamed_table",
    "write_table",
]
