"""``modelDescription.xml`` of a contact model: variables, units, what depends on what."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from xml.etree import ElementTree as ET

from casadi_contact.conventions import POSE_NAMES
from casadi_contact.quantities import ANGLE, FORCE, LENGTH, TORQUE, quantity
from casadi_contact.transcription.export_c import ExportedModel

# In base units of SI, with a display unit where people use another.
_UNITS: dict[str, dict[str, str]] = {
    "s": {"s": "1"},
    "mm": {"m": "1", "factor": "0.001"},
    "rad": {"rad": "1"},
    "N": {"kg": "1", "m": "1", "s": "-2"},
    "N.mm": {"kg": "1", "m": "2", "s": "-2", "factor": "0.001"},
    "1": {},
}
_UNIT_OF_KIND = {LENGTH: "mm", ANGLE: "rad", FORCE: "N", TORQUE: "N.mm"}


@dataclass(frozen=True)
class Variable:
    """One of the unit's variables; its value reference is its place (the order of ``fmi3.c``)."""

    name: str
    unit: str
    causality: str
    said: str


def variables(model: ExportedModel) -> Iterator[Variable]:
    """Time, pose, loads, root loads; validity and expected errors where the model has them."""
    yield Variable("time", "s", "independent", "simulation time")
    for name in POSE_NAMES:
        yield Variable(name, _unit(name), "input", "pose of the moving body in the fixed body's frame, Rx Ry Rz")
    for load in model.load_names:
        yield Variable(load, _unit(load), "output", "load on the fixed body, in its frame, about its origin")
    for patch in model.patch_names:
        yield Variable(f"root_{patch}", "1", "output", "signed root load: below zero out of contact")
    if model.trusted:
        yield Variable("validity", "1", "local", "1 well inside what was learned, 0 far outside")
        for load in model.load_names:
            yield Variable(f"expected_error_{load}", _unit(load), "local", "95 % of errors lie below it")


def _unit(name: str) -> str:
    return _UNIT_OF_KIND[quantity(name).kind]


def model_description(model: ExportedModel, name: str, token: str, start: Sequence[float]) -> str:
    """The XML text; start: the pose (6) before any input."""
    head = {"fmiVersion": "3.0", "modelName": name, "instantiationToken": token, "description": model.description}
    head |= {"generationTool": f"casadi_contact {version('casadi_contact')}"}
    root = ET.Element("fmiModelDescription", head)
    derivatives = {"providesDirectionalDerivatives": "true", "providesAdjointDerivatives": "true"}
    ET.SubElement(root, "ModelExchange", {"modelIdentifier": name, **derivatives})
    steps = {"canHandleVariableCommunicationStepSize": "true"}
    ET.SubElement(root, "CoSimulation", {"modelIdentifier": name, **steps, **derivatives})
    units = ET.SubElement(root, "UnitDefinitions")
    for unit, base in _UNITS.items():
        element = ET.SubElement(units, "Unit", {"name": unit})
        ET.SubElement(element, "BaseUnit", base)
        if unit == "rad":
            ET.SubElement(element, "DisplayUnit", {"name": "deg", "factor": repr(180.0 / math.pi)})
    ET.SubElement(ET.SubElement(root, "LogCategories"), "Category", {"name": "logStatusWarning"})
    ET.SubElement(root[-1], "Category", {"name": "logStatusError"})
    ET.SubElement(root, "DefaultExperiment", {"startTime": "0.0", "stopTime": "1.0"})
    listed = ET.SubElement(root, "ModelVariables")
    structure = ET.SubElement(root, "ModelStructure")
    all_variables = list(enumerate(variables(model)))
    pose = [str(k) for k, variable in all_variables if variable.causality == "input"]
    for k, variable in all_variables:
        attributes = {"name": variable.name, "valueReference": str(k), "causality": variable.causality}
        attributes |= {"variability": "continuous", "unit": variable.unit, "description": variable.said}
        if str(k) in pose:
            attributes["start"] = repr(float(start[pose.index(str(k))]))
        ET.SubElement(listed, "Float64", attributes)
    for tag in ("Output", "InitialUnknown"):
        for k, variable in all_variables:
            if variable.causality == "output":
                depends = {"dependencies": " ".join(pose), "dependenciesKind": " ".join(["dependent"] * len(pose))}
                ET.SubElement(structure, tag, {"valueReference": str(k), **depends})
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
