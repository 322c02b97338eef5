"""Samples of a contact model, their HDF5 file, and what surrogates take from them: rows to fit, and the record."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from casadi_contact.core.conventions import POSE_NAMES, REFLECTION, Array
from casadi_contact.core.files.containers import new_hdf5, open_hdf5
from casadi_contact.core.files.reading import existing_file
from casadi_contact.scenes.scene import Scene

DOMAINS = ("D1", "D2", "D3", "D4", "D5", "D6", "D7")
TRAIN, VALIDATION, TEST = 0, 1, 2
ROLES = ("train", "validation", "test")

FORMAT_NAME = "casadi_contact samples"
FORMAT_VERSION = 2
COLUMNS = ("poses", "wrenches", "gaps", "domain", "role")


@dataclass(frozen=True)
class Dropped:
    """Poses (m, 6) [mm, rad] of a plan that became no samples, with their domain (m,) 1..7.

    Contact runs off the elements there, pulls, or has no equilibrium (the pose is then that of the last iteration). A
    surrogate is not valid in such regions, however close its samples are. The provenance counts the reasons.
    """

    poses: Array = field(default_factory=lambda: np.empty((0, 6)))
    domain: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.uint8))


@dataclass(frozen=True)
class Samples:
    """Poses and what the contact model says there (one row per sample).

    poses (n, 6) [mm, rad]; wrenches (n, patches, 6) on the fixed body [N, N·mm] and gaps (n, patches) [mm], gaps NaN
    where the model knows none; domain (n,) 1..7; role (n,) TRAIN, VALIDATION or TEST; provenance says what made them
    (settings, versions, plan digest, number of dropped samples by reason); dropped holds the poses of these.
    """

    scene: Scene
    poses: Array
    wrenches: Array
    gaps: Array
    domain: np.ndarray
    role: np.ndarray
    provenance: Mapping[str, Any] = field(default_factory=dict, compare=False)
    dropped: Dropped = field(default_factory=Dropped, compare=False)

    def __post_init__(self) -> None:
        count, patches = len(self.poses), len(self.scene.patches)
        shapes = {"poses": (count, 6), "wrenches": (count, patches, 6), "gaps": (count, patches)}
        for name, shape in {**shapes, "domain": (count,), "role": (count,)}.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"samples: {name} has shape {getattr(self, name).shape}, expected {shape}")
        for name, least, most in (("domain", 1, len(DOMAINS)), ("role", 0, len(ROLES) - 1)):
            column = getattr(self, name)
            if (wrong := ~np.isin(column, range(least, most + 1))).any():
                found = f"{column[wrong][0]:g} in row {int(wrong.argmax()) + 1}"
                raise ValueError(f"samples: {name} is {found}, expected a whole number from {least} to {most}")
            object.__setattr__(self, name, column.astype(np.uint8))

    def __len__(self) -> int:
        return len(self.poses)

    def loads(self, names: Sequence[str] | None = None) -> Array:
        """Named loads (n, loads), the scene's if no names are given; raises ValueError for an unknown name."""
        names = self.scene.load_names if names is None else names
        return np.einsum("lpk,npk->nl", self.scene.selection(names), self.wrenches)

    def select(self, domain: str | None = None, role: int | Sequence[int] | None = None) -> Samples:
        """The samples of a domain ("D1") and of one or more roles (TRAIN, VALIDATION, TEST); None takes all."""
        if domain is not None and domain not in DOMAINS:
            raise ValueError(f"unknown domain {domain!r}, expected one of {', '.join(DOMAINS)}")
        rows = np.ones(len(self), dtype=bool) if domain is None else self.domain == DOMAINS.index(domain) + 1
        return self.rows(rows if role is None else rows & np.isin(self.role, role))

    def rows(self, chosen: np.ndarray) -> Samples:
        """The samples of these rows, a mask (n,) or numbers."""
        columns: dict[str, Any] = {name: getattr(self, name)[chosen] for name in COLUMNS}
        return replace(self, **columns)

    def join_samples(self, more: Samples) -> Samples:
        """These samples and then more of the same scene; raises ValueError for another scene."""
        if more.scene.digest != self.scene.digest:
            raise ValueError("the samples to join belong to another scene (digests differ)")
        columns: dict[str, Any] = {name: np.concatenate([getattr(self, name), getattr(more, name)]) for name in COLUMNS}
        lost = (np.concatenate([getattr(s.dropped, name) for s in (self, more)]) for name in ("poses", "domain"))
        return replace(self, **columns, dropped=Dropped(*lost))

    def dropped_shares(self) -> dict[str, float]:
        """Share of the plan that became no samples, by domain; empty where nothing was dropped."""
        numbers = range(1, len(DOMAINS) + 1)
        lost, kept = (np.array([(domain == d).sum() for d in numbers]) for domain in (self.dropped.domain, self.domain))
        found = zip(DOMAINS, lost.tolist(), (lost + kept).tolist(), strict=True)
        return {name: part / planned for name, part, planned in found if planned} if lost.any() else {}

    def dropped_reasons(self, domain: str) -> str:
        """Why some of a domain's plan became no samples, and how many for each reason, the most first; may be empty."""
        reasons = self.provenance.get("dropped", {}).get(domain, {})
        return "; ".join(f"{reason} ({count})" for reason, count in sorted(reasons.items(), key=lambda r: -r[1]))

    def counts(self) -> dict[str, dict[str, int]]:
        """Number of samples by domain name and role name."""
        return {
            name: {r: int(((self.domain == d) & (self.role == k)).sum()) for k, r in enumerate(ROLES)}
            for d, name in enumerate(DOMAINS, start=1)
        }


def partial_folder(path: str | Path) -> Path:
    """The folder beside a samples file that holds it while it is being drawn."""
    return Path(path).with_name(Path(path).name + ".partial")


def write_samples(path: str | Path, samples: Samples) -> None:
    """Write samples to an HDF5 file; the same samples give the same bytes. Raises OSError where it cannot."""
    with new_hdf5(Path(path)) as file:
        file.attrs["format"] = FORMAT_NAME
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["scene_toml"] = samples.scene.to_toml()
        file.attrs["provenance"] = json.dumps(samples.provenance, sort_keys=True)
        lost = {f"dropped_{name}": getattr(samples.dropped, name) for name in ("poses", "domain")}
        for name, column in {**{name: getattr(samples, name) for name in COLUMNS}, **lost}.items():
            # Checksums: a flipped bit is found when the file is read, not in a network's error.
            file.create_dataset(name, data=column, fletcher32=column.size > 0, track_times=False)


def read_samples(path: str | Path) -> Samples:
    """Read a samples file; ValueError for one that is damaged, is something else, or has another format."""
    path = Path(path)
    if not path.exists() and partial_folder(path).is_dir():
        raise FileNotFoundError(f"{path} is not complete: run the same sampling again to finish it")
    with open_hdf5(existing_file(path, "samples file")) as file:
        if file.attrs.get("format") != FORMAT_NAME:
            raise ValueError(f"{path} is not a samples file of casadi_contact")
        version = file.attrs.get("format_version", 0)
        if version != FORMAT_VERSION:
            raise ValueError(f"{path} has samples format {version}, expected {FORMAT_VERSION}: draw the samples again")
        columns = {name: np.asarray(file[name][()]) for name in COLUMNS}
        dropped = Dropped(np.asarray(file["dropped_poses"][()]), np.asarray(file["dropped_domain"][()]))
        provenance = json.loads(str(file.attrs["provenance"]))
        scene = Scene.from_toml(str(file.attrs["scene_toml"]))
        return Samples(scene, **columns, provenance=provenance, dropped=dropped)


LoadErrors = dict[str, dict[str, float]]


class LoadModel(Protocol):
    """Anything that gives named loads (n, loads) for poses (n, 6)."""

    load_names: tuple[str, ...]

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, loads)."""


def load_errors(names: Sequence[str], got: Array, reference: Array) -> LoadErrors:
    """{load: {"rms": √mean(e²), "max": max|e|, "mean": mean|e|}} of loads (n, loads), in N and N·mm."""
    off = np.abs(got - reference)
    found = {"rms": np.sqrt(np.mean(off**2, axis=0)), "max": off.max(axis=0), "mean": off.mean(axis=0)}
    return {load: {what: float(values[k]) for what, values in found.items()} for k, load in enumerate(names)}


def domain_errors(model: LoadModel, samples: Samples, role: int = TEST) -> dict[str, LoadErrors]:
    """`load_errors` against the samples' own (teacher grid) loads in each domain that has samples of this role."""
    errors = {}
    for domain in DOMAINS:
        part = samples.select(domain, role)
        if len(part):
            errors[domain] = load_errors(model.load_names, model(part.poses), part.loads(model.load_names))
    return errors


def mirrored(samples: Samples) -> Samples:
    """The samples in the mirror, sides exchanged; for a scene of two patches that mirror each other."""
    wrenches, gaps = samples.wrenches[:, ::-1] * REFLECTION, samples.gaps[:, ::-1]
    return replace(samples, poses=samples.poses * REFLECTION, wrenches=wrenches, gaps=gaps)


def either_side(samples: Samples) -> Samples:
    """The samples with half of them, chosen at random, mirrored, so that the network of one side learns from both.

    Samples in which a side carries no load come both as they are and mirrored: without them a surrogate predicts
    thousands of newtons of false contact on the other side.
    """
    reflected, chosen = mirrored(samples), np.random.default_rng(0).random(len(samples)) < 0.5
    free = (samples.wrenches == 0.0).all(axis=2).any(axis=1)
    return samples.rows(~chosen | free).join_samples(reflected.rows(chosen | free))


def fitted_rows(samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Mask (n,) of training and validation rows, and among these the mask of validation rows."""
    role = np.asarray(samples.role)
    rows = role != TEST
    nonempty("training", rows & (role != VALIDATION))
    return rows, role[rows] == VALIDATION


def nonempty(what: str, rows: np.ndarray) -> None:
    """Raises ValueError if no row is left."""
    if not rows.any():
        raise ValueError(f"samples hold no row for {what}, expected at least one: draw them, or add them to the table")


def finite(name: str, values: Array) -> Array:
    """Pass finite values through; raises ValueError naming the first bad row otherwise."""
    bad = ~np.isfinite(values).reshape(len(values), -1).all(axis=1)
    if bad.any():
        raise ValueError(f"samples hold NaN or infinity in {name} at row {int(np.argmax(bad))}, expected numbers")
    return values


def samples_record(samples: Samples) -> dict[str, Any]:
    """The record's ``drawn_from``, ``samples``, ``test_samples``, ``dropped`` and ranges of a surrogate."""
    used = samples.select(role=(TRAIN, VALIDATION))
    names, drawn_from = samples.scene.load_names, samples.provenance.get("models")
    return {
        **({"drawn_from": drawn_from} if drawn_from else {}),
        "samples": {d: int(((samples.domain == k) & (samples.role != TEST)).sum()) for k, d in enumerate(DOMAINS, 1)},
        "test_samples": {d: held for d, count in samples.counts().items() if (held := count["test"])},
        "dropped": samples.dropped_shares(),
        "pose_range": _ranges(POSE_NAMES, used.poses),
        "load_range": _ranges(names, used.loads(names)),
    }


def _ranges(names: Sequence[str], columns: Array) -> dict[str, list[float]]:
    return {name: [float(column.min()), float(column.max())] for name, column in zip(names, columns.T, strict=True)}
