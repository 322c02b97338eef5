"""Surrogate files: HDF5 with the scene, a JSON record and the plain weights; no code inside, no pickle.

The bytes are sealed with a digest (`files.containers`).

/                attributes kind, format, structure
/scene           scene as TOML text
/record          JSON text: what trained it, errors per domain, versions, command
/networks/NAME   attributes activation, output_scale (one number, or one per output); data sets input_shift,
                 input_scale, weight_0, bias_0, ...
/confidence      where the surrogate was calibrated: a data set for each field of `Confidence`, and a group network
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from casadi_contact.core.files.containers import new_hdf5, open_hdf5
from casadi_contact.core.files.reading import existing_file, one_line
from casadi_contact.networks.network import Network, read_network, write_network
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.confidence import Confidence

KIND = "casadi_contact surrogate"
FORMAT = 6


@dataclass(frozen=True)
class Content:
    """What a surrogate file holds."""

    structure: str
    scene: Scene
    networks: Mapping[str, Network]
    record: Mapping[str, Any]
    confidence: Confidence | None = None


def write_file(path: str | Path, content: Content) -> None:
    """Put the file in the place of `path`. Raises ValueError for a record that is not JSON, OSError if unwritable."""
    path = Path(path)
    try:
        record = json.dumps(content.record, ensure_ascii=False, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"surrogate record is not plain JSON ({error}), expected text, finite numbers and lists"
        ) from None
    with new_hdf5(path) as file:
        file.attrs["kind"] = KIND
        file.attrs["format"] = FORMAT
        file.attrs["structure"] = content.structure
        file["scene"] = content.scene.to_toml()
        file["record"] = record
        networks = file.create_group("networks", track_order=True)
        for name, network in content.networks.items():
            write_network(networks.create_group(name), network)
        if content.confidence is not None:
            group = file.create_group("confidence")
            for name, value in content.confidence.numbers().items():
                group[name] = np.asarray(value, dtype="<f8")
            write_network(group.create_group("network"), content.confidence.network)


def read_file(path: str | Path) -> Content:
    """Read a surrogate file.

    Raises FileNotFoundError, or ValueError that says whether the file is foreign, newer or damaged.
    """
    path = existing_file(path, "surrogate file", "a surrogate's .h5")
    if path.suffix == ".toml":
        cure = "casadi-contact show draws a scene, casadi-contact build makes a surrogate of it"
        raise ValueError(f"{path} is a scene file, expected a surrogate's .h5: {cure}")
    with open_hdf5(path) as file:
        if file.attrs.get("kind") != KIND:
            raise ValueError(f"{path} is not a surrogate file, expected one written by casadi_contact")
        if (found := file.attrs.get("format")) != FORMAT:
            raise ValueError(
                f"{path} has surrogate format {found}, expected {FORMAT}: build the surrogate again with this version"
            )
        try:
            return Content(
                str(file.attrs["structure"]),
                Scene.from_toml(file["scene"][()].decode()),
                {name: read_network(group) for name, group in file["networks"].items()},
                dict(json.loads(file["record"][()].decode())),
                _read_confidence(file["confidence"]) if "confidence" in file else None,
            )
        except (TypeError, ValueError, RecursionError) as error:
            raise ValueError(f"{path}: {one_line(error)}") from None


def _read_confidence(group: h5py.Group) -> Confidence:
    arrays = {field.name: group[field.name][()] for field in fields(Confidence) if field.name != "network"}
    values: dict[str, Any] = {name: array if array.ndim else float(array) for name, array in arrays.items()}
    return Confidence(**values, network=read_network(group["network"]))
