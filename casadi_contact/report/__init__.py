"""Tables for the terminal, charts and the report page, made from result files and surrogates only."""

from casadi_contact.report.charts import draw_charts
from casadi_contact.report.figure import family_name
from casadi_contact.report.kernel_speed import kernel_speed_tables, read_kernel_speed
from casadi_contact.report.surrogate_page import write_report
from casadi_contact.report.tables import evaluation_tables, fine_grid_remark, read_evaluation

__all__ = [
    "draw_charts",
    "evaluation_tables",
    "family_name",
    "fine_grid_remark",
    "kernel_speed_tables",
    "read_evaluation",
    "read_kernel_speed",
    "write_report",
]
