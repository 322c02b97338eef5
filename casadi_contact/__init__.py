"""casadi_contact: neural surrogates of deformable joint contact as CasADi functions with exact derivatives.

The method is that of Eskinazi and Fregly, "Surrogate modeling of deformable joint contact using artificial neural
networks" (2015); see README.md. The names below are imported when they are first used, so that importing the package
costs next to nothing.
"""

from typing import TYPE_CHECKING

__version__ = "0.2.0.dev0"

__all__ = [
    "Assembly",
    "CallableModel",
    "CellFoundation",
    "Cells",
    "ContactFrames",
    "ContactInOpti",
    "CupFoundation",
    "ElasticFoundation",
    "FiniteElements",
    "Hexahedra",
    "MuscleContact",
    "OnFoundation",
    "PolarFoundation",
    "PoseEstimation",
    "RayCastFoundation",
    "Rays",
    "Scene",
    "StaticEquilibrium",
    "build",
    "choose",
    "export_c",
    "export_fmu",
    "foundation",
    "load_assembly",
    "load_scene",
    "load_surrogate",
    "opensim",
    "refine",
    "relax",
    "sensitive_directions",
    "settle",
    "settled_function",
    "verify",
]

if TYPE_CHECKING:
    from casadi_contact.cli.pipeline import build
    from casadi_contact.contact.callable_model import CallableModel
    from casadi_contact.contact.cells.basis import Cells
    from casadi_contact.contact.cells.foundation import CellFoundation
    from casadi_contact.contact.choice import foundation
    from casadi_contact.contact.cup import CupFoundation
    from casadi_contact.contact.elements.foundation import ElasticFoundation
    from casadi_contact.contact.finite_elements.layer import Hexahedra
    from casadi_contact.contact.finite_elements.model import FiniteElements
    from casadi_contact.contact.model_checks import sensitive_directions
    from casadi_contact.contact.polar.foundation import PolarFoundation
    from casadi_contact.contact.polar.lines import Rays
    from casadi_contact.contact.ray_cast import RayCastFoundation
    from casadi_contact.contact.relax import relax
    from casadi_contact.contact.settle import settle
    from casadi_contact.export.c_source import export_c
    from casadi_contact.export.fmu import export_fmu
    from casadi_contact.optimisation.assembly import Assembly
    from casadi_contact.optimisation.assembly.file import load_assembly
    from casadi_contact.optimisation.contact_frames import ContactFrames
    from casadi_contact.optimisation.contact_in_opti import ContactInOpti, settled_function
    from casadi_contact.optimisation.muscle_contact import MuscleContact
    from casadi_contact.optimisation.pose_estimation import PoseEstimation
    from casadi_contact.optimisation.static_equilibrium import StaticEquilibrium
    from casadi_contact.optimisation.verification import verify
    from casadi_contact.scenes import opensim
    from casadi_contact.scenes.loading import load_scene
    from casadi_contact.scenes.scene import Scene
    from casadi_contact.surrogate.load import load_surrogate
    from casadi_contact.surrogate.on_foundation import OnFoundation
    from casadi_contact.workflow.benchmark.choose import choose
    from casadi_contact.workflow.refine import refine
else:
    _HOME = {
        "Assembly": "optimisation.assembly",
        "CallableModel": "contact.callable_model",
        "CellFoundation": "contact.cells.foundation",
        "Cells": "contact.cells.basis",
        "ContactFrames": "optimisation.contact_frames",
        "ContactInOpti": "optimisation.contact_in_opti",
        "CupFoundation": "contact.cup",
        "ElasticFoundation": "contact.elements.foundation",
        "FiniteElements": "contact.finite_elements.model",
        "Hexahedra": "contact.finite_elements.layer",
        "MuscleContact": "optimisation.muscle_contact",
        "OnFoundation": "surrogate.on_foundation",
        "PolarFoundation": "contact.polar.foundation",
        "PoseEstimation": "optimisation.pose_estimation",
        "RayCastFoundation": "contact.ray_cast",
        "Rays": "contact.polar.lines",
        "Scene": "scenes.scene",
        "StaticEquilibrium": "optimisation.static_equilibrium",
        "build": "cli.pipeline",
        "choose": "workflow.benchmark.choose",
        "export_c": "export.c_source",
        "export_fmu": "export.fmu",
        "foundation": "contact.choice",
        "load_assembly": "optimisation.assembly.file",
        "load_scene": "scenes.loading",
        "load_surrogate": "surrogate.load",
        "opensim": "scenes.opensim",
        "refine": "workflow.refine",
        "relax": "contact.relax",
        "sensitive_directions": "contact.model_checks",
        "settle": "contact.settle",
        "settled_function": "optimisation.contact_in_opti",
        "verify": "optimisation.verification",
    }

    def __getattr__(name: str) -> object:
        """Import a public name from its module, once (PEP 562)."""
        from importlib import import_module

        if name not in _HOME:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module = import_module(f"{__name__}.{_HOME[name]}")
        globals()[name] = value = getattr(module, name, module)  # opensim is a module itself
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
