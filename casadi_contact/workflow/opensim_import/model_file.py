"""The XML of an OpenSim or JAM model: its contact elements, and the rest, for the opensim wheel.

A model file is another's: it is parsed without entities or a document type, up to a size, and nothing in it runs.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from casadi_contact.core.files.reading import MIB, checked_size, existing_file, finite_number
from casadi_contact.scenes.material import Layer

MOST_MODEL = 64 * MIB
CONTACT_PREFIX = "Smith2018"


@dataclass(frozen=True)
class ContactMesh:
    """A Smith2018ContactMesh: file as the model names it; frame: path of the frame it lies in, moved by location [m]
    and turned by orientation [rad], x-y-z body-fixed; its layer [MPa, mm]; factors of its size."""

    name: str
    file: str
    frame: str
    location: tuple[float, ...]
    orientation: tuple[float, ...]
    layer: Layer
    scale_factors: tuple[float, ...]
    variable: bool


@dataclass(frozen=True)
class ContactForce:
    """A Smith2018ArticularContactForce: rays run from the casting mesh to the target."""

    name: str
    target: str
    casting: str
    applied: bool
    max_proximity: float
    formulation: str
    lumped: bool


@dataclass(frozen=True)
class ModelFile:
    """What the XML says of contact, what else of JAM it holds by name and kind, and the rest, for the wheel."""

    meshes: Mapping[str, ContactMesh]
    contacts: tuple[ContactForce, ...]
    unmapped: tuple[str, ...]
    rest: str


def opensim_root(path: str | Path) -> ET.Element:
    """The root of an .osim file, or of settings of an OpenSim tool. Raises FileNotFoundError, and ValueError for a file
    that is no such XML, or holds entities."""
    path = existing_file(path, "OpenSim file", "an .osim or .xml file")
    checked_size(path, MOST_MODEL)
    text = path.read_text("utf-8-sig", errors="replace")
    if re.search(r"<!\s*(DOCTYPE|ENTITY)", text):
        raise ValueError(f"{path} holds a document type or entities, expected plain XML: delete them")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise ValueError(f"{path} is no XML ({error}), expected an .osim or .xml file") from None
    if root.tag != "OpenSimDocument":
        raise ValueError(f"{path} holds <{root.tag}>, expected an <OpenSimDocument>")
    return root


def read_model(path: str | Path) -> ModelFile:
    """Raises FileNotFoundError, and ValueError for a file that is no model, holds entities, or names a mesh that it
    lacks."""
    root = opensim_root(path)
    if root.find("Model") is None:
        raise ValueError(f"{path} holds no <Model>, expected an .osim file")
    meshes = {mesh.name: mesh for mesh in map(_mesh, root.iter(f"{CONTACT_PREFIX}ContactMesh"))}
    contacts = tuple(map(_contact, root.iter(f"{CONTACT_PREFIX}ArticularContactForce")))
    for contact in contacts:
        if missing := {contact.target, contact.casting} - set(meshes):
            raise ValueError(f"{path}: {contact.name} names the mesh {', '.join(missing)}, it has {', '.join(meshes)}")
    known = {f"{CONTACT_PREFIX}{kind}" for kind in ("ContactMesh", "ArticularContactForce")}
    others = [e for e in root.iter() if e.tag.startswith(CONTACT_PREFIX) and e.tag not in known]
    unmapped = tuple(f"{e.get('name', 'without a name')}: {e.tag}" for e in others)
    for parent in list(root.iter()):
        for element in [child for child in parent if child.tag.startswith(CONTACT_PREFIX)]:
            parent.remove(element)
    return ModelFile(meshes, contacts, unmapped, ET.tostring(root, encoding="unicode"))


def find_mesh(name: str, folders: list[Path]) -> Path:
    """The mesh file that a model names, in one of some folders (its usual subfolder Geometry too): by its whole name,
    else by a file of another format, else by one whose name ends that of the model's, or begins or ends with the same
    words. Raises FileNotFoundError naming --geometry."""
    wanted = Path(name.replace("\\", "/"))
    searched = [place for folder in folders for place in (folder, folder / "Geometry")]
    for file in (folder / each for folder in searched for each in (wanted, wanted.name)):
        if file.is_file():
            return file
    for fits in (_same, _ends_alike):
        for folder in searched:
            found = [file for file in sorted(folder.glob("*")) if file.suffix.lower() in _MESHES and fits(file, wanted)]
            if found:
                return found[0]
    where = ", ".join(map(str, searched))
    raise FileNotFoundError(f"mesh {name} is not in {where}: name the folder that holds it with --geometry")


_MESHES = (".stl", ".obj", ".ply", ".vtp", ".vtk", ".off")


def _same(file: Path, wanted: Path) -> bool:
    return file.stem.lower() == wanted.stem.lower()


def _ends_alike(file: Path, wanted: Path) -> bool:
    """femur_cartilage.obj for lenhart2015-R-femur-cartilage.stl: all words of the file end the model's name."""
    words, all_words = (re.split(r"[^a-z0-9]+", path.stem.lower()) for path in (file, wanted))
    return len(words) > 1 and all_words[-len(words) :] == words


def _text(element: ET.Element, key: str, default: str) -> str:
    return (element.findtext(key) or default).strip()


def _values(element: ET.Element, key: str, default: str) -> tuple[float, ...]:
    where = f"{element.get('name')}, {key}"
    return tuple(finite_number(word, where) for word in _text(element, key, default).split())


def _flag(element: ET.Element, key: str, default: str) -> bool:
    return _text(element, key, default).lower() == "true"


def _mesh(element: ET.Element) -> ContactMesh:
    given = (("elastic_modulus", "1e6", 1e-6), ("poissons_ratio", "0.5", 1.0), ("thickness", "0.005", 1e3))
    return ContactMesh(
        name=element.get("name", ""),
        file=_text(element, "mesh_file", ""),
        frame=_text(element, "socket_frame", "/ground"),
        location=_values(element, "location", "0 0 0"),
        orientation=_values(element, "orientation", "0 0 0"),
        layer=Layer(*(unit * _values(element, key, default)[0] for key, default, unit in given)),
        scale_factors=_values(element, "scale_factors", "1 1 1"),
        variable=_flag(element, "use_variable_thickness", "false"),
    )


def _contact(element: ET.Element) -> ContactForce:
    target, casting = (_text(element, f"socket_{mesh}_mesh", "").split("/")[-1] for mesh in ("target", "casting"))
    return ContactForce(
        name=element.get("name", ""),
        target=target,
        casting=casting,
        applied=_flag(element, "appliesForce", "true"),
        max_proximity=_values(element, "max_proximity", "0.01")[0],
        formulation=_text(element, "elastic_foundation_formulation", "linear"),
        lumped=_flag(element, "use_lumped_contact_model", "true"),
    )
