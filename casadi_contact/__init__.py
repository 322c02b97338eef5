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
    "ContactFrames",
    "ContactInOpti",
    "CupFoundation",
    "ElasticFoundation",
    "PolarFoundation",
    "RayCastFoundation",
    "Scene",
    "build",
    "choose",
    "foundation",
    "load_assembly",
    "load_scene",
    "load_surrogate",
    "refine",
    "relax",
    "sensitive_directions",
    "settle",
    "verify",
]

if TYPE_CHECKING:
    from casadi_contact.assembly import Assembly, load_assembly
    from casadi_contact.benchmark import choose
    from casadi_contact.contact import (
        CallableModel,
        CellFoundation,
        CupFoundation,
        ElasticFoundation,
        PolarFoundation,
        RayCastFoundation,
        foundation,
    )
    from casadi_contact.optimisation import ContactFrames, ContactInOpti
    from casadi_contact.pipeline import build
    from casadi_contact.scenes import Scene, load_scene
    from casadi_contact.statics import relax, sensitive_directions, settle
    from casadi_contact.structures import load_surrogate
    from casadi_contact.verification import refine, verify
else:
    _NAMES = {
        "assembly": ("Assembly", "load_assembly"),
        "benchmark": ("choose",),
        "contact": (
            *("CallableModel", "CellFoundation", "CupFoundation", "ElasticFoundation", "PolarFoundation"),
            *("RayCastFoundation", "foundation"),
        ),
        "optimisation": ("ContactFrames", "ContactInOpti"),
        "pipeline": ("build",),
        "scenes": ("Scene", "load_scene"),
        "statics": ("relax", "sensitive_directions", "settle"),
        "structures": ("load_surrogate",),
        "verification": ("refine", "verify"),
    }
    _HOME = {name: home for home, names in _NAMES.items() for name in names}

    def __getattr__(name: str) -> object:
        """Import a public name from its subpackage, once (PEP 562)."""
        from importlib import import_module

        if name not in _HOME:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
