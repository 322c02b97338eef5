"""The XML of an OpenSim or JAM model: its contact elements, and the rest, for the opensim wheel.

A model file is another's: it is parsed without entities or a document type, up to a size, and nothing in it runs.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

from casadi_contact.core.files.reading import MIB, checked_size, existing_file, finite_number
from casadi_contact.geometry.mesh_formats import FORMATS
from casadi_contact.scenes.material import Layer

MOST_MODEL = 64 * MIB
SURFACES = ("Smith2018ContactMesh", "ContactMesh", "ContactSphere", "ContactHalfSpace")
JAM, ELASTIC = "Smith2018ArticularContactForce", "ElasticFoundationForce"
HERTZ = ", whose force grows with depth to the power 1.5, that of an elastic layer with its square"
HERTZIAN = {"HuntCrossleyForce": HERTZ, "SmoothSphereHalfSpaceForce": HERTZ}
SPRINGS_MM = 10.0  # of a layer with ν = 0 that is as stiff as given springs


@dataclass(frozen=True)
class Surface:
    """One of `SURFACES`; frame: path of the frame it lies in, moved by location [m] and turned by orientation [rad],
    x-y-z body-fixed. A mesh has a file, as the model names it, factors of its size and, of JAM, its layer [MPa, mm],
    and where its thickness varies within bounds [mm] the file `back` that it lies on; a sphere its radius [m]."""

    name: str
    kind: str
    frame: str
    location: tuple[float, ...]
    orientation: tuple[float, ...]
    file: str
    scale_factors: tuple[float, ...]
    radius: float
    layer: Layer
    back: str
    bounds_mm: tuple[float, ...]


@dataclass(frozen=True)
class ContactForce:
    """Rays run from the casting mesh to the target. Of JAM both bear their layers; else `springs` [MPa/mm] stand on the
    casting mesh, with coefficients of friction as in a scene."""

    name: str
    casting: str
    target: str
    applied: bool
    max_proximity: float = 0.02
    formulation: str = "linear"
    lumped: bool = True
    springs: float = 0.0
    friction: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class ModelFile:
    """What the XML says of contact, what else of contact it holds, and the rest, for the wheel."""

    surfaces: Mapping[str, Surface]
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
        root = ET.fromstring(re.sub(r"(</?\w+)::", r"\1.", text))  # OpenSim's own tags, which are no XML
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
    surfaces = {element.get("name", ""): _surface(element) for element in root.iter() if element.tag in SURFACES}
    contacts = [_of_jam(element) for element in root.iter(JAM)]
    for contact in contacts:
        if missing := {contact.target, contact.casting} - set(surfaces):
            raise ValueError(f"{path}: {contact.name} names {', '.join(missing)}, the meshes are {', '.join(surfaces)}")
    unmapped = []
    for element in root.iter(ELASTIC):
        of_all = {each: _text(each, "geometry", "") for each in element.iter(f"{ELASTIC}.ContactParameters")}
        springs = {name.split("/")[-1]: each for each, names in of_all.items() for name in names.split()}
        contacts += _elastic(element, surfaces, {name: each for name, each in springs.items() if name in surfaces})
        others = springs.keys() - surfaces.keys()
        unmapped += [f"{element.get('name')}: {name}, which is no mesh, sphere or half-space" for name in others]
    for parent in list(root.iter()):
        for element in list(parent):
            if element.tag.startswith("Smith2018") or element.tag in (*SURFACES, ELASTIC, *HERTZIAN):
                parent.remove(element)
                if element.tag not in (*SURFACES, JAM, ELASTIC):
                    name = element.get("name", "without a name")
                    unmapped.append(f"{name}: {element.tag}{HERTZIAN.get(element.tag, '')}")
                elif element.find(".//*[@name='casting_mesh_contact_params']") is not None:  # of older files
                    unmapped.append(f"{element.get('name')}: its own materials; those of its meshes are taken")
    return ModelFile(surfaces, tuple(contacts), tuple(unmapped), ET.tostring(root, encoding="unicode"))


def find_mesh(name: str, folders: list[Path]) -> Path:
    """The mesh file that a model names, in one of some folders (its usual subfolder Geometry too): by its whole name,
    else by a file of another format, else by one whose words, two or more, end the model's name. Raises
    FileNotFoundError naming --geometry."""
    wanted = Path(name.replace("\\", "/"))
    searched = [place for folder in folders for place in (folder, folder / "Geometry")]
    for file in (folder / each for folder in searched for each in (wanted, wanted.name)):
        if file.is_file():
            return file
    files = [file for folder in searched for file in sorted(folder.glob("*")) if file.suffix.lower() in FORMATS]
    words = [re.split(r"[^a-z0-9]+", path.stem.lower()) for path in (wanted, *files)]
    for fewest in (len(words[0]), 2):  # femur_cartilage.obj for lenhart2015-R-femur-cartilage.stl
        for file, own in zip(files, words[1:], strict=True):
            if len(own) >= fewest and words[0][-len(own) :] == own:
                return file
    where = ", ".join(map(str, searched))
    raise FileNotFoundError(f"mesh {name} is not in {where}: name the folder that holds it with --geometry")


def _text(element: ET.Element, key: str, default: str) -> str:
    return (element.findtext(key) or default).strip()


def _values(element: ET.Element, key: str, default: str) -> tuple[float, ...]:
    where, words, count = f"{element.get('name')}, {key}", _text(element, key, default).split(), len(default.split())
    if len(words) != count:
        raise ValueError(f"{where}: got {' '.join(words)}, expected {count} numbers")
    return tuple(finite_number(word, where) for word in words)


def _flag(element: ET.Element, key: str, default: str) -> bool:
    return _text(element, key, default).lower() == "true"


def _surface(element: ET.Element) -> Surface:
    body = _text(element, "body_name", "ground")  # of OpenSim 3
    frame = _text(element, "socket_frame", f"{'' if body == 'ground' else 'bodyset/'}{body}")
    given = (("elastic_modulus", "1e6", 1e-6), ("poissons_ratio", "0.5", 1.0), ("thickness", "0.005", 1e3))
    return Surface(
        name=element.get("name", ""),
        kind=element.tag,
        frame="/" + "/".join(word for word in frame.split("/") if word not in ("", "..")),
        location=_values(element, "location", "0 0 0"),
        orientation=_values(element, "orientation", "0 0 0"),
        file=_text(element, "mesh_file", _text(element, "filename", "")),
        scale_factors=_values(element, "scale_factors", "1 1 1"),
        radius=_values(element, "radius", "0")[0],
        layer=Layer(*(unit * _values(element, key, default)[0] for key, default, unit in given)),
        back=_text(element, "mesh_back_file", "") if _flag(element, "use_variable_thickness", "false") else "",
        bounds_mm=tuple(
            1e3 * _values(element, f"{end}_thickness", m)[0] for end, m in (("min", "0.001"), ("max", "0.01"))
        ),
    )


def _of_jam(element: ET.Element) -> ContactForce:
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


def _elastic(
    element: ET.Element, surfaces: Mapping[str, Surface], springs: Mapping[str, ET.Element]
) -> Iterator[ContactForce]:
    """Of an ElasticFoundationForce, whose parameters come by surface: springs stand on each mesh against each other
    surface, with half of their stiffness where that is a mesh too."""
    units = {"static_friction": 1.0, "dynamic_friction": 1.0, "viscous_friction": 1e-3, "dissipation": 1e-3}
    for pair in combinations(springs, 2):
        meshes = [name for name in pair if surfaces[name].kind == "ContactMesh"]
        for casting in meshes if surfaces[pair[0]].frame != surfaces[pair[1]].frame else []:
            (target,) = {*pair} - {casting}
            friction = {key: unit * _values(springs[casting], key, "0")[0] for key, unit in units.items()}
            friction["transition_velocity"] = 1e3 * _values(element, "transition_velocity", "0.01")[0]
            stiffness = 1e-9 * _values(springs[casting], "stiffness", "0")[0] / len(meshes)
            name, applied = "_".join((element.get("name", ""), casting, target)), _flag(element, "appliesForce", "true")
            yield ContactForce(name, casting, target, applied, springs=stiffness, friction=friction)
