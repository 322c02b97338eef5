"""A contact model tried at a few poses about the first touch, before poses are sought on it: what would fail for hours,
or be learned, is told at once."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from casadi_contact.contact.model import CallableModel, ContactModel
from casadi_contact.contact.torques import wrong_torques
from casadi_contact.contact.touch import ways_of_pressing
from casadi_contact.conventions import Array, evenly, pose_text
from casadi_contact.quantities import FORCE, of_kind, quantity, two_digits

_log = logging.getLogger(__name__)

_POSES = 5
_PLACES, _BACK_MM, _FURTHEST_MM = 16, 1.0, 20.0
_MOVED_MM, _BESIDE_MM = 0.1, 1e-10
_CLEARLY = 0.01  # of a load: noise of a model is less
_ABOUT = 10.0  # times the wanted force: poses that carry more tell less
_NOISY = 2.0  # times the tolerance: a little noise still lets poses settle
_STEPS_PER_NOISE = 100.0  # differences over such a step tell slopes to a per cent
_ROUNDS = 3
_REMEMBERED = 6.0  # times the spread of one force asked again: differences of noise alone are less


@dataclass(frozen=True)
class _Contact:
    """Contacts (k,) of the model: poses (k, 6), the patch of each by number and its force (k, 3) [N]."""

    model: ContactModel
    poses: Array
    patches: np.ndarray
    forces: Array

    def after(self, way_mm: float) -> Array:
        """Forces (k, 3) after a way along each contact's own force."""
        moved = self.poses.copy()
        moved[:, :3] += way_mm * self.forces / np.linalg.norm(self.forces, axis=1, keepdims=True)
        return _forces(self.model, moved)[np.arange(len(moved)), self.patches]

    def text(self, row: int) -> str:
        """One of them in words."""
        force = ", ".join(f"{value:.4g}" for value in self.forces[row])
        names = self.model.patch_names
        return f"force ({force}) N of patch {names[self.patches[row]]} at {pose_text(self.poses[row], names)}"


def try_model(model: ContactModel, touching: Array, wanted: Mapping[str, Array], tolerance_n: float) -> None:
    """Raise ValueError for a model that cannot be settled on, `_refuse_reversed`, `_refuse_memory`, `_refuse_noise`, or
    whose torques do not belong to its forces, `_refuse_torques`.

    It is asked at up to 5 of the poses (n, 6) at the first touch, pressed on so far that they carry about the wanted
    forces (n,), which are by load name as `first_touch` takes them. A model without wrenches is not tried. A logged
    warning names loads whose noise is larger than the scene's tolerance.
    """
    if not len(touching) or not hasattr(model, "wrenches"):
        return
    chosen = evenly(len(touching), _POSES)
    ways = ways_of_pressing(model, len(touching), wanted)[chosen]
    asked = np.linalg.norm([wanted[name][chosen] for name in of_kind(list(wanted), FORCE)], axis=0)
    asked = np.maximum(asked, 1.0)
    poses = _pressed(model, touching[chosen], ways, asked)
    forces = _forces(model, poses)
    loaded = np.nan_to_num(np.linalg.norm(forces, axis=2))
    about = (loaded.sum(axis=1) < _ABOUT * asked)[:, None]
    rows, patches = np.nonzero((loaded > 0.0) & (about | ~about.any()))
    if len(rows):
        contact = _Contact(model, poses[rows], patches, forces[rows, patches])
        slope = _refuse_reversed(contact)
        _refuse_memory(contact, slope, tolerance_n)
        _refuse_noise(contact, slope, tolerance_n)
        _refuse_torques(contact)
        _tell_noise(contact)


def _pressed(model: ContactModel, poses: Array, ways: Array, wanted_n: Array) -> Array:
    """Poses (n, 6) moved along unit vectors (n, 3) until they carry about the wanted forces (n,); those that carry more
    at first are moved back against their force. By the secant method on roots of forces, which grow about evenly, until
    the wanted force lies between two places, then by bisection."""
    begin = _forces(model, poses).sum(axis=1)
    size = np.linalg.norm(begin, axis=1)
    deep = size > wanted_n
    ways = np.where(deep[:, None], -begin / np.maximum(size, 1e-300)[:, None], ways)

    def at(way_mm: Array) -> Array:
        moved = poses.copy()
        moved[:, :3] += way_mm[:, None] * ways
        return moved

    here, off = np.zeros(len(poses)), np.sqrt(size) - np.sqrt(wanted_n)
    more, less = np.where(deep, 0.0, np.nan), np.where(deep, np.nan, 0.0)
    there = np.where(deep, _BACK_MM, _MOVED_MM)
    for _ in range(_PLACES):
        carried = np.sqrt(np.linalg.norm(_forces(model, at(there)).sum(axis=1), axis=1))
        found = carried - np.sqrt(wanted_n)
        more, less = np.where(found > 0.0, there, more), np.where(found <= 0.0, there, less)
        rise = (found - off) / np.where(there != here, there - here, np.inf)
        further = np.where(rise != 0.0, -found / np.where(rise != 0.0, rise, 1.0), _MOVED_MM)
        here, off = there, found
        further = np.where(np.isfinite(further), np.clip(further, -_FURTHEST_MM, _FURTHEST_MM), _MOVED_MM)
        secant = there + further
        there = np.where(np.isnan(more + less), secant, 0.5 * (more + less))
    return at(np.where(np.isnan(more), less, more))


def _refuse_reversed(contact: _Contact) -> Array:
    """ValueError for loads on the moving body instead of the fixed one; else the stiffness (k,) [N/mm].

    A force F on the fixed body grows as the moving one goes its way: |F(t + δ·F/|F|)| > |F(t - δ·F/|F|)|. A model is
    refused where each contact loses more than 1 % of its force over 2δ = 0.2 mm.
    """
    behind, ahead = (np.linalg.norm(contact.after(way), axis=1) for way in (-_MOVED_MM, _MOVED_MM))
    if (ahead < (1.0 - _CLEARLY) * behind).all():
        raise ValueError(
            f"the contact model's loads are those on the moving body: its {contact.text(0)} is {behind[0]:.4g} N 0.1 "
            f"mm behind and {ahead[0]:.4g} N 0.1 mm ahead, expected more ahead: return -wrenches, the loads on the "
            "fixed body"
        )
    return np.asarray((ahead - behind) / (2.0 * _MOVED_MM))


def _refuse_memory(contact: _Contact, slope: Array, tolerance_n: float) -> None:
    """ValueError for forces that depend on what was asked before, as with hysteresis or a solver that goes on from its
    last solution: no function of the pose fits them.

    A model that takes pose after pose is asked 0.1 mm behind, here, 0.1 mm ahead, here again, and so to both sides, in
    three rounds. Means of the forces here, by where it came from, and the first one asked, may differ by twice the
    tolerance [N] of settling and six times the spread of the rounds. What is less than 1 % of the force may be taken
    for noise; the cure says how.
    """
    size = np.linalg.norm(contact.forces, axis=1)
    along = contact.forces / size[:, None]
    aside = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    ways = np.stack([-along, along, -aside, aside], axis=1)
    moved = np.tile(contact.poses[:, None, None, None, :], (1, _ROUNDS, len(ways[0]), 2, 1))
    moved[:, :, :, 0, :3] += _MOVED_MM * ways[:, None]
    found = _forces(contact.model, moved.reshape(-1, 6)).reshape(len(size), -1, len(contact.model.patch_names), 3)
    here = found[np.arange(len(size)), :, contact.patches].reshape(len(size), _ROUNDS, len(ways[0]), 2, 3)[..., 1, :]
    means = np.concatenate([here.mean(axis=1), contact.forces[:, None]], axis=1)
    off = np.linalg.norm(means[:, :, None] - means[:, None], axis=-1).max(axis=(1, 2))
    spread = np.sqrt(here.var(axis=1, ddof=1).sum(axis=2).mean(axis=1)) / size
    off = np.where(np.isfinite(off), off, 0.0)
    row = int(off.argmax())
    if off[row] > _NOISY * tolerance_n + _REMEMBERED * float(np.fmax.reduce(spread)) * size[row]:
        noise = f", or {_let_pass(contact, row, off[row], slope)}" if off[row] < _CLEARLY * size[row] else ""
        raise ValueError(
            f"the contact model remembers: its {contact.text(row)} differs by {two_digits(off[row])} N with the poses "
            "asked before, expected a function of the pose alone: start its solver from one state at every pose, "
            f"without friction, plasticity or other hysteresis{noise}"
        )


def _refuse_noise(contact: _Contact, slope: Array, tolerance_n: float) -> None:
    """ValueError for forces that differ, asked once more δ = 1e-10 mm beside, by more than twice the tolerance [N] of
    settling and what contact itself changes there, slope·δ."""
    noise = np.abs(contact.after(_BESIDE_MM) - contact.forces).max(axis=1)
    noise = np.where(np.isfinite(noise), noise, 0.0)
    row = int(noise.argmax())
    if noise[row] <= _NOISY * (tolerance_n + float(np.fmax(slope[row], 0.0)) * _BESIDE_MM):
        return
    raise ValueError(
        f"the contact model is noisy: its {contact.text(row)} differs by {two_digits(noise[row])} N when asked once "
        f"more, expected at most twice the {tolerance_n:g} N within which poses settle: "
        f"{_let_pass(contact, row, noise[row], slope)}"
    )


def _let_pass(contact: _Contact, row: int, noise_n: float, slope: Array) -> str:
    """What to set so that poses settle on a model whose force differs by so much there."""
    cure = f"set settle_tolerance_n = {two_digits(3.0 * noise_n)} or more in the scene's [sampling]"
    if isinstance(contact.model, CallableModel) and slope[row] > 0.0:
        step = two_digits(_STEPS_PER_NOISE * noise_n / slope[row])
        cure += f", and give cc.CallableModel step_mm={step}, step_rad={two_digits(float(step) / 25.0)} or more"
    return cure


def _refuse_torques(contact: _Contact) -> None:
    """ValueError for torques of another unit, sign or origin than forces of contact ask for; a model that gives none,
    or no slopes, is not asked."""
    if not hasattr(contact.model, "wrench_jacobian"):
        return
    wrenches, slopes = contact.model.wrench_jacobian(contact.poses)
    rows = np.arange(len(contact.poses))
    if wrong := wrong_torques(contact.poses, wrenches[rows, contact.patches], slopes[rows, contact.patches]):
        raise ValueError(f"the contact model's torques are {wrong}; seen at its {contact.text(0)}")


def _tell_noise(contact: _Contact) -> None:
    """A warning of loads that differ by more than their tolerance (RMS) when asked again: settling may allow what a
    surrogate cannot learn."""
    model, count = contact.model, len(contact.poses)
    again = model(np.repeat(contact.poses, _ROUNDS, axis=0)).reshape(count, _ROUNDS, -1)
    noise = dict(zip(model.load_names, np.sqrt(again.var(axis=1, ddof=1).mean(axis=0)), strict=True))
    tolerances = model.scene.tolerances
    if said := ", ".join(
        f"{name} differs by {two_digits(noise[name])} {quantity(name).unit} (tolerance {tolerances[name]:g})"
        for name in noise
        if noise[name] > tolerances[name]
    ):
        _log.warning(
            "the contact model is noisier than the scene's tolerances, asked again at one pose (RMS): %s; on held-back "
            "samples such noise counts as error: let its solver converge further, or raise [tolerances]",
            said,
        )


def _forces(model: ContactModel, poses: Array) -> Array:
    wrenches: Array = model.wrenches(poses)  # type: ignore[attr-defined]
    return wrenches[..., :3]
