"""Whether a user's contact model is still the one that samples were drawn from.

The library's own models are known by their names, version and settings; a function of a user's is known by what it
returns alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from casadi_contact.conventions import Array, evenly, pose_text
from casadi_contact.dataset import Samples
from casadi_contact.quantities import FORCE, TORQUE, quantity, two_digits
from casadi_contact.sampling.chunk import WrenchModel, part_gaps, part_wrenches
from casadi_contact.statics.settle import NOT_FINITE

_LOADED, _FREE = 8, 2  # samples asked again
_SHARE = 0.005  # of the loads: a model noisy to 0.1 % never says the same twice
_GAP_MM = 0.01
_COMPONENTS = {FORCE: slice(0, 3), TORQUE: slice(3, 6)}


def refuse_other_loads(model: WrenchModel, samples: Samples, where: Path, tolerance_n: float) -> None:
    """Raise ValueError, naming pose and load, where a model no longer says what samples drawn from it say.

    It is asked at up to 8 of the samples that carry a load and 2 that carry none, spread over all. The RMS difference
    of a load may reach the scene's tolerance of it, or a share of the RMS force (torque) of all parts where that is
    more: 0.5 %, or what the force tolerance [N] of settling is of the RMS force, by which a noisy model may differ.
    That of gaps may reach 0.01 mm, or 0.5 %. Poses at which the model now gives no finite loads are passed over,
    up to half.
    """
    if not len(samples):
        return
    loaded = (samples.wrenches != 0.0).any(axis=(1, 2))
    asked_of = ((np.flatnonzero(loaded), _LOADED), (np.flatnonzero(~loaded), _FREE))
    rows = np.concatenate([rows[evenly(len(rows), most)] for rows, most in asked_of])
    asked = samples.rows(rows)
    parts = len(asked.scene.parts)
    wrenches, gaps = part_wrenches(model, asked.poses, parts), part_gaps(model, asked.poses, parts)
    finite = np.asarray(np.isfinite(wrenches).all(axis=(1, 2)))
    cure = f"give the model of then, choose another folder, or delete {where}"
    if 2 * int(finite.sum()) < len(rows):
        at = pose_text(asked.poses[~finite][0], asked.scene.patch_names)
        raise ValueError(f"{where} was drawn from another contact model: {NOT_FINITE} now at {at}: {cure}")
    for name, kept, now, limit in _compared(asked.rows(finite), wrenches[finite], gaps[finite], tolerance_n):
        off, unit = np.abs(now - kept), quantity(name).unit
        if _rms(off) > limit:
            row = int(np.nanargmax(off))
            at = pose_text(asked.poses[finite][row], asked.scene.patch_names)
            raise ValueError(
                f"{where} was drawn from another contact model: {name} was {kept[row]:.5g} {unit}, now {now[row]:.5g} "
                f"{unit} at {at}, expected the same within {two_digits(limit)} {unit} RMS: {cure}"
            )


def _compared(
    kept: Samples, wrenches: Array, gaps: Array, tolerance_n: float
) -> Iterator[tuple[str, Array, Array, float]]:
    """Each load, and the gap of each part: its name, what it was (n,), what it is now, and how far RMS may be off."""
    scene, names = kept.scene, kept.scene.load_names
    now = replace(kept, wrenches=wrenches).loads()
    sizes = {kind: _rms(np.linalg.norm(kept.wrenches[..., of], axis=(1, 2))) for kind, of in _COMPONENTS.items()}
    share = max(_SHARE, tolerance_n / sizes[FORCE]) if sizes[FORCE] > 0.0 else _SHARE
    for column, name in enumerate(names):
        limit = max(scene.tolerances[name], share * sizes[quantity(name).kind])
        yield name, kept.loads()[:, column], now[:, column], limit
    for column, part in enumerate(scene.parts):
        before = kept.gaps[:, column]
        yield f"gap_{part.name}", before, gaps[:, column], max(_GAP_MM, _SHARE * _rms(before))


def _rms(values: Array) -> float:
    """Of the values that are known; 0 where none is."""
    known = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0
