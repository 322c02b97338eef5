"""The C that all compiled contact models share: pressure law, named loads, root loads, derivatives by the pose."""

from collections.abc import Iterable, Mapping, Sequence

from casadi_contact.contact.friction import motion_functions
from casadi_contact.contact.pressure_law import law_of
from casadi_contact.core.conventions import load_selection
from casadi_contact.networks.kernel.source import c_of_functions, c_text, guards
from casadi_contact.scenes.scene import Scene

C_LAWS = ("linear", "log")
C_FOLDER = "casadi_contact.contact.c"


def kernel_source(
    scene: Scene, loads: Sequence[str], roots: int, patch_source: str, lanes: int, inputs: int = 6
) -> str:
    """C99 of a scene's named loads and root loads (of all patches, or 0), up to guarded_value, _jacobian, _hessian and
    values_of, all static. patch_source defines ``patch_loads``, with up to `lanes` numbers in a vector.

    inputs: of 12 or 17, loads depend on a pose and its rates, and on coefficients of friction; roots then has to be 0.
    """
    selection = load_selection(loads, scene.patch_names)
    _, modulus, thickness = law_of(scene.material)
    sizes: dict[str, float | str] = {
        **{"LOADS": len(loads), "ROOTS": roots, "PATCHES": len(scene.patch_names), "WIDEST": 8, "WIDTH": 8},
        **{"LOGARITHMIC": int(scene.material.law == "log"), "MODULUS": modulus, "THICKNESS": thickness},
        **{"MOST_LANES": lanes, "MOVING": int(inputs > 6), "COEFFICIENTS": max(inputs - 12, 0)},
        **{"VARIABLES": inputs, "LOCALS": inputs - 6, "FRAME_OF": "moving_frame" if inputs > 6 else "frame_of"},
        **{"REFERENCE_LOAD": float(scene.reference_load), "GAP_SLOPE": float(scene.gap_slope)},
    }
    picked = ", ".join(f"{{{', '.join(map(braces, selection[:, p]))}}}" for p in range(len(scene.patch_names)))
    components = ", ".join(str(-1 if n.index is None else n.index) for n in scene.normal_loads)
    motion = c_of_functions(motion_functions(inputs, scene.friction)) if inputs > 6 else ""
    return "\n".join(
        [
            *definitions(sizes),
            c_text("core.h"),
            c_text("pose.h"),
            f"static const double selection[PATCHES][LOADS + 1][6] = {{{picked}}};",
            f"static const int normal_component[PATCHES] = {{{components}}};",
            f"static const double normal_sign[PATCHES] = {braces(n.sign for n in scene.normal_loads)};",
            c_text("lanes.h", C_FOLDER),
            c_text("foundation.h", C_FOLDER),
            *([motion, c_text("moving.h", C_FOLDER), c_text("friction.h", C_FOLDER)] if inputs > 6 else []),
            patch_source,
            c_text("kernel.h", C_FOLDER),
            guards(inputs="VARIABLES"),
        ]
    )


def definitions(sizes: Mapping[str, float | str], tables: Mapping[str, Iterable[float]] | None = None) -> list[str]:
    """C of numbers, by name, and of arrays of doubles, by name and size: ``ray_cos[RAYS]``."""
    defined = [f"#undef {name}\n#define {name} {value}" for name, value in sizes.items()]
    return defined + [f"static const double {name} = {braces(values)};" for name, values in (tables or {}).items()]


def braces(values: Iterable[float]) -> str:
    """Numbers as a C initialiser."""
    return "{" + ", ".join(repr(float(value)) for value in values) + "}"
