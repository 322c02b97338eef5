"""Tables for the terminal and charts, made from result files only."""

from casadi_contact.report.charts import draw_charts
from casadi_contact.report.tables import evaluation_tables, read_evaluation

__all__ = ["draw_charts", "evaluation_tables", "read_evaluation"]
