"""From plain networks to CasADi functions with exact, cheap first and second derivatives, and to C."""

from casadi_contact.transcription.export_c import ExportedModel, export_c
from casadi_contact.transcription.function_file import load_function, save_function
from casadi_contact.transcription.functions import function_with_derivatives

__all__ = ["ExportedModel", "export_c", "function_with_derivatives", "load_function", "save_function"]
