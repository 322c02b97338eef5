"""casadi_contact: neural surrogates of deformable joint contact as CasADi functions with exact derivatives.

The method is that of Eskinazi and Fregly, "Surrogate modeling of deformable joint contact using artificial neural
networks" (2015); see README.md. The names below are imported when they are first used, so that importing the package
costs next to nothing.
"""

from typing import TYPE_CHECKING

__version__ = "0.2.0.dev0"

if TYPE_CHECKING:
    from casadi_contact.cli.pipeline import build as build
    from casadi_contact.contact.callable_model import CallableModel as CallableModel
    from casadi_contact.contact.cells.basis import Cells as Cells
    from casadi_contact.contact.cells.foundation import CellFoundation as CellFoundation
    from casadi_contact.contact.choice import foundation as foundation
    from casadi_contact.contact.cup import CupFoundation as CupFoundation
    from casadi_contact.contact.elements.foundation import ElasticFoundation as ElasticFoundation
    from casadi_contact.contact.finite_elements.layer import Hexahedra as Hexahedra
    from casadi_contact.contact.finite_elements.model import FiniteElements as FiniteElements
    from casadi_contact.contact.model_checks import sensitive_directions as sensitive_directions
    from casadi_contact.contact.polar.foundation import PolarFoundation as PolarFoundation
    from casadi_contact.contact.polar.lines import Rays as Rays
    from casadi_contact.contact.ray_cast import RayCastFoundation as RayCastFoundation
    from casadi_contact.contact.relax import relax as relax
    from casadi_contact.contact.settle import settle as settle
    from casadi_contact.export.c_source import export_c as export_c
    from casadi_contact.export.fmu import export_fmu as export_fmu
    from casadi_contact.optimisation.assembly.assembly import Assembly as Assembly
    from casadi_contact.optimisation.assembly.file import load_assembly as load_assembly
    from casadi_contact.optimisation.contact_frames import ContactFrames as ContactFrames
    from casadi_contact.optimisation.contact_in_opti import ContactInOpti as ContactInOpti
    from casadi_contact.optimisation.contact_in_opti import settled_function as settled_function
    from casadi_contact.optimisation.muscle_contact import MuscleContact as MuscleContact
    from casadi_contact.optimisation.pose_estimation import PoseEstimation as PoseEstimation
    from casadi_contact.optimisation.static_equilibrium import StaticEquilibrium as StaticEquilibrium
    from casadi_contact.optimisation.verification import verify as verify
    from casadi_contact.scenes import opensim as opensim
    from casadi_contact.scenes.loading import load_scene as load_scene
    from casadi_contact.scenes.scene import Scene as Scene
    from casadi_contact.surrogate.load import load_surrogate as load_surrogate
    from casadi_contact.surrogate.on_foundation import OnFoundation as OnFoundation
    from casadi_contact.workflow.benchmark.choose import choose as choose
    from casadi_contact.workflow.refine import refine as refine
else:
    _HOME = {
        "Assembly": "optimisation.assembly.assembly",
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

    __all__ = list(_HOME)

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
