"""Contact models as functional mock-up units (FMI 3.0, https://fmi-standard.org/docs/3.0/).

An FMU holds ``modelDescription.xml`` (variables, units, dependencies), the C sources, and a library compiled for this
platform.
"""

import hashlib
import math
import platform
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from string import Template
from typing import Any
from xml.etree import ElementTree as ET

from casadi_contact.core.compiler import DATA_FILE, SUFFIX, portable_library
from casadi_contact.core.conventions import POSE_NAMES
from casadi_contact.core.files.writing import replacing, write_bytes, write_text
from casadi_contact.core.quantities import quantity
from casadi_contact.export.c_source import TEMPLATES, c_source, header, pose_or_example, template_words
from casadi_contact.networks.kernel.source import ExportedModel, c_text

# In base units of SI, with a display unit where people use another.
_UNITS: dict[str, dict[str, str]] = {
    "s": {"s": "1"},
    "mm": {"m": "1", "factor": "0.001"},
    "rad": {"rad": "1"},
    "N": {"kg": "1", "m": "1", "s": "-2"},
    "N.mm": {"kg": "1", "m": "2", "s": "-2", "factor": "0.001"},
    "1": {},
}


def variables(model: ExportedModel) -> Iterator[tuple[str, str, str, str]]:
    """Name, unit, causality and description of time, pose, loads, root loads, and of validity and expected errors where
    the model has them, in the order of ``fmi3.c``, which is that of value references."""
    names = (POSE_NAMES, model.load_names)
    pose, loads = ([(name, quantity(name).unit.replace("·", ".")) for name in of] for of in names)
    yield "time", "s", "independent", "simulation time"
    for name, unit in pose:
        yield name, unit, "input", "pose of the moving body in the fixed body's frame, Rx Ry Rz"
    for name, unit in loads:
        yield name, unit, "output", "load on the fixed body, in its frame, about its origin"
    for patch in model.patch_names:
        yield f"root_{patch}", "1", "output", "signed root load: below zero out of contact"
    if model.calibrated:
        yield "validity", "1", "local", "1 well inside what was learned, 0 far outside"
        for name, unit in loads:
            yield f"expected_error_{name}", unit, "local", "95 % of errors lie below it"


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
    pose, outputs = list[str](), list[str]()
    for k, (called, unit, causality, said) in enumerate(variables(model)):
        attributes = {"name": called, "valueReference": str(k), "causality": causality}
        attributes |= {"variability": "continuous", "unit": unit, "description": said}
        if causality == "input":
            attributes["start"] = repr(start[len(pose)])
            pose.append(str(k))
        outputs += [str(k)] if causality == "output" else []
        ET.SubElement(listed, "Float64", attributes)
    depends = {"dependencies": " ".join(pose), "dependenciesKind": " ".join(["dependent"] * len(pose))}
    for tag in ("Output", "InitialUnknown"):
        for reference in outputs:
            ET.SubElement(structure, tag, {"valueReference": reference, **depends})
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


_PROCESSORS = {"AMD64": "x86_64", "arm64": "aarch64"}  # as FMI names them
_BUILD = """\
<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{name}">
    <SourceFileSet language="C99">
      <SourceFile name="fmi3.c"/>
      <SourceFile name="{name}.c"/>
    </SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
"""
_DATE = (2000, 1, 1, 0, 0, 0)  # of every entry, so that the same model gives the same bytes


def export_fmu(
    model: Any,
    path: str | Path,
    name: str | None = None,
    loads: Iterable[str] | None = None,
    start: Sequence[float] | None = None,
) -> Path:
    """Write an FMU (FMI 3.0, model exchange and co-simulation, directional and adjoint derivatives); return its path.

    Inputs are the pose [mm, rad], from `start` (6; `example_pose()` if left out) on; outputs the loads [N, N·mm] and
    root loads; validity and expected errors can be read. Compiled for any processor of this machine's kind, or as
    $CASADI_CONTACT_CFLAGS says. Raises CompilerError (an OSError) without a compiler, ValueError for an unusable name
    and a pose that is not six finite numbers."""
    exported, pose = model.exported(loads), pose_or_example(model, start)
    name = name or exported.name
    if name == "fmi3":
        raise ValueError(f"function name {name!r} is not usable, fmi3.c is FMI's own interface: choose another")
    path, words = Path(path), template_words(exported, name)
    words["start"] = ", ".join(map(repr, pose))
    sources = {f"{name}.h": header(exported, name), f"{name}.c": c_source(exported, name)}
    words["token"] = token = hashlib.sha256(f"{sources[f'{name}.c']}{words['start']}".encode()).hexdigest()
    sources["fmi3.c"] = Template(c_text("fmi3.c", TEMPLATES)).substitute(words)
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
        place = Path(folder)
        for file, text in sources.items():
            write_text(place / file, text)
        write_bytes(place / DATA_FILE, exported.data)
        library = portable_library(place, ["fmi3.c", f"{name}.c"], f"{name}{SUFFIX}").read_bytes()
    entries: dict[str, str | bytes] = {"modelDescription.xml": model_description(exported, name, token, pose)}
    entries |= {f"sources/{file}": text for file, text in sources.items()}
    if exported.data:
        entries[f"sources/{DATA_FILE}"] = exported.data
    entries["sources/buildDescription.xml"] = _BUILD.format(name=name)
    processor = _PROCESSORS.get(platform.machine(), platform.machine())
    entries[f"binaries/{processor}-{sys.platform}/{name}{SUFFIX}"] = library
    with replacing(path) as beside, zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, content in entries.items():
            archive.writestr(zipfile.ZipInfo(entry, _DATE), content, zipfile.ZIP_DEFLATED)
    return path
