"""Contact models as functional mock-up units (FMI 3.0, https://fmi-standard.org/docs/3.0/)."""

from casadi_contact.transcription.fmu.export import export_fmu

__all__ = ["export_fmu"]
