"""Peers: what one might use instead of these surrogates, fitted on the same samples and timed in the same run.

Run ``python -m problems.studies.peers knee --preset quick`` after a build of the scene. Each regressor of `regressors`
learns loads as they are, and the targets of our own networks ("roots": signed root loads and ratios of the local pose
of a patch); from all samples, and from those near the motion (D1). Those with a formula are timed as C that CasADi
generates of it, in single calls as networks are; all others as one batch of poses, their cheapest form. A predicted
force that would pull is clamped to zero, as the paper does [EF15 §3.5].
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import casadi as ca
import numpy as np
import typer

from casadi_contact.cli.options import DEFAULT_PRESET
from casadi_contact.cli.pipeline import chart
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array, as_poses, check_loads, local_poses
from casadi_contact.core.terminal import PlainConsole, progress_bars, run_program
from casadi_contact.core.workers import one_thread
from casadi_contact.networks.frames import rotation
from casadi_contact.networks.network import Regression
from casadi_contact.samples.samples import Samples, finite, fitted_rows
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.patch.networks import patch_networks, ratios_name, root_name
from casadi_contact.surrogate.patch.regressions import patch_regressions, root_target
from casadi_contact.workflow.benchmark.candidates import Candidate, time_batch, time_single_calls
from casadi_contact.workflow.benchmark.front_file import Point
from casadi_contact.workflow.project import Project
from problems.studies.casadi_forms import generated_library
from problems.studies.regressors import METHODS, Fit, b_spline, learned

LOADS, ROOTS, SPLINE = "loads", "roots", "B-spline"
NODES = 16_000  # of a grid for B-splines at most, as many as samples: 5 along each of 6 axes


class Peer:
    """Fits as a load model poses (n, 6) -> loads (n, L): one fit called "loads" of the pose, or those of signed root
    loads s and ratios ρ of every patch's local pose, which give N = N0·max(s, 0)² and N·ρ."""

    def __init__(self, scene: Scene, load_names: Sequence[str], fits: Mapping[str, Fit]) -> None:
        self.scene, self.load_names, self.fits = scene, tuple(load_names), fits
        signs = {normal.loads[0]: normal.sign for normal in scene.normal_loads if normal.component is not None}
        self._sign = np.array([signs.get(name, 0.0) for name in self.load_names])
        self._patches, self._free = patch_networks(scene, {}), list(scene.pose_space.free)

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L); none pulls."""
        poses = self.scene.pose_space.project(as_poses(poses))
        if LOADS in self.fits:
            loads = self.fits[LOADS].predict(poses[:, self._free])
            return np.where(self._sign * loads < 0.0, 0.0, loads)
        loads = np.zeros((len(poses), len(self.load_names)))
        for p, patch in enumerate(self.scene.patches):
            x = local_poses(poses, patch.anchor_mm)[:, self._free]
            normal = self.scene.reference_load * np.maximum(self.fits[root_name(patch.name)].predict(x), 0.0) ** 2
            columns, own = self._shares(p)
            none = np.zeros((len(x), columns.shape[1]))
            ratios = self.fits[ratios_name(patch.name)].predict(x) if columns.any() else none
            loads += normal * (ratios @ columns.T + own)
        return loads

    def _shares(self, p: int) -> tuple[Array, Array]:
        """How much of each ratio of patch p a load takes (L, ratios), and of its normal load (L,)."""
        patch, picked = self._patches[p], self.scene.selection(self.load_names)[:, p]
        return picked[:, patch.columns], picked @ patch.own

    def function(self) -> ca.Function | None:
        """casadi.Function pose (6) -> loads (L), where every fit has a formula."""
        if any(fit.expression is None for fit in self.fits.values()):
            return None
        pose, space = ca.MX.sym("pose", 6), self.scene.pose_space
        on_space = ca.mtimes(ca.sparsify(ca.DM(space.matrix)), pose) + ca.DM(space.offset)
        if LOADS in self.fits:
            loads = self.fits[LOADS].expression(on_space[self._free])  # type: ignore[misc]
            loads = ca.if_else(ca.DM(self._sign) * loads < 0.0, 0.0, loads)
            return ca.Function("peer", [pose], [loads])
        found = []
        for p, patch in enumerate(self.scene.patches):
            local = ca.vertcat(on_space[:3] + ca.mtimes(rotation(on_space[3:]), ca.DM(patch.anchor_mm)), on_space[3:])
            x, (columns, own) = local[self._free], self._shares(p)
            s = self.fits[root_name(patch.name)].expression(x)  # type: ignore[misc]
            ratios = self.fits[ratios_name(patch.name)].expression(x) if columns.any() else ca.MX(columns.shape[1], 1)  # type: ignore[misc]
            normal = self.scene.reference_load * ca.fmax(s, 0) ** 2
            found.append(normal * (ca.mtimes(ca.DM(columns), ratios) + ca.DM(own)))
        return ca.Function("peer", [pose], [sum(found[1:], found[0])])


def tasks(samples: Samples, names: Sequence[str]) -> dict[str, list[Regression]]:
    """What is to be learned, by target; ValueError for NaN or no training rows."""
    rows, validation = fitted_rows(samples)
    poses, loads = finite("poses", samples.poses[rows]), finite("loads", samples.loads(names)[rows])
    ones, free = np.ones(len(poses)), list(samples.scene.pose_space.free)
    raw = Regression(LOADS, poses[:, free], loads, ones, validation, 0.0, domain=samples.domain[rows])
    return {LOADS: [raw], ROOTS: patch_regressions(samples, deeper=False)}


def fitted(method: Any, regressions: Sequence[Regression], *, near: bool) -> dict[str, Fit]:
    """A method fitted on the training rows, near: on those of D1 alone, in random order."""
    fits = {}
    for regression in regressions:
        rows = ~regression.validation & ((np.asarray(regression.domain) == 1) | (not near))
        order = np.random.default_rng(0).permutation(np.flatnonzero(rows))
        weights = np.reshape(regression.weights, (len(regression.weights), -1)).mean(axis=1)
        fits[regression.name] = learned(method, regression.inputs[order], regression.targets[order], weights[order])
    return fits


def splines(samples: Samples, target: str, names: Sequence[str], nodes: int) -> dict[str, Fit]:
    """B-splines over the box of the D1 samples, of loads that the scene's teacher grid has at the nodes."""
    scene, near = samples.scene, samples.select("D1") if (samples.domain == 1).any() else samples
    model, space = ElasticFoundation(scene, scene.grids["teacher"]), scene.pose_space
    columns, free = [model.load_names.index(name) for name in names], list(space.free)

    def whole(x: Array) -> Array:
        poses = np.zeros((len(x), 6))
        poses[:, free] = x
        return space.project(poses)

    if target == LOADS:
        x = near.poses[:, free]
        return {LOADS: b_spline(lambda x: model(whole(x))[:, columns], x.min(axis=0), x.max(axis=0), nodes)}
    fits = {}
    for p, patch in enumerate(scene.patches):
        x = local_poses(near.poses, patch.anchor_mm)[:, free]

        def poses_at(x: Array, anchor: Array = patch.anchor_mm) -> Array:
            poses = whole(x)
            poses[:, :3] -= local_poses(np.hstack([np.zeros((len(poses), 3)), poses[:, 3:]]), anchor)[:, :3]
            return poses

        def root(x: Array, p: int = p) -> Array:
            poses = poses_at(x)
            wrench = model.wrenches(poses)[:, p]
            return root_target(scene.patches[p].normal.of(wrench), model.gaps(poses)[:, p], scene)[:, None]

        def ratios(x: Array, p: int = p) -> Array:
            """Of nodes out of contact, which have none, those of the nearest node in contact."""
            from scipy.spatial import cKDTree

            wrench, patch = model.wrenches(poses_at(x))[:, p], scene.patches[p]
            normal, size = patch.normal.of(wrench), np.where(np.ptp(x, axis=0), np.ptp(x, axis=0), 1.0)
            touching = np.flatnonzero(normal > scene.boundary_load)
            nearest = touching[cKDTree(x[touching] / size).query(x / size)[1]]
            picked = patch_networks(scene, {})[p].columns
            return np.asarray(wrench[nearest][:, picked] / normal[nearest, None])

        for name, values in ((root_name(patch.name), root), (ratios_name(patch.name), ratios)):
            fits[name] = b_spline(values, x.min(axis=0), x.max(axis=0), nodes)
    return fits


def regressor_candidates(family: str, samples: Samples, names: Sequence[str]) -> Iterator[Candidate]:
    """The regressors of a family, of both targets and both choices of samples."""
    to_learn = tasks(samples, names)
    for settings, method in METHODS[family].items():
        for near in (False, True):
            for target, regressions in to_learn.items():
                began, name = time.process_time(), f"{family} {settings}, {target}{' (D1)' if near else ''}"
                rows = regressions[0]
                count = int((~rows.validation & ((np.asarray(rows.domain) == 1) | (not near))).sum())
                try:
                    peer = Peer(samples.scene, names, fitted(method, regressions, near=near))
                except (ValueError, np.linalg.LinAlgError, MemoryError) as error:
                    yield Candidate(Point(name, family, failure=" ".join(str(error).split())))
                    continue
                yield _candidate(name, family, peer, count, time.process_time() - began)


def spline_candidates(samples: Samples, names: Sequence[str]) -> Iterator[Candidate]:
    """B-splines of both targets."""
    for target in (LOADS, ROOTS):
        began = time.process_time()
        peer = Peer(samples.scene, names, splines(samples, target, names, NODES))
        axes = len(samples.scene.pose_space.free)
        count = max(4, int(NODES ** (1.0 / axes) + 1e-9))
        name = f"{SPLINE} {count}^{axes} nodes, {target}"
        yield _candidate(name, SPLINE, peer, count**axes, time.process_time() - began)


def _candidate(name: str, family: str, peer: Peer, samples: int, seconds: float) -> Candidate:
    """As C that CasADi generates where there is a formula; else as one batch of poses."""
    function, batch = peer.function(), partial(time_batch, peer)
    remark = "timed as one batch of poses" if function is None else "C generated by CasADi; batch: NumPy"
    point = Point(name, family, samples=samples, training_seconds=seconds, remark=remark)
    if function is None:
        return Candidate(point, peer, {"value": batch, "batch": batch})
    value = ca.external(function.name(), generated_library([function]))
    return Candidate(point, peer, {"value": partial(time_single_calls, value), "batch": batch})


def peer_candidates(samples: Samples, names: Sequence[str] | None = None) -> Iterator[Candidate]:
    """Every peer, fitted on the training samples on one thread, one after the other.

    names: loads to predict, the scene's if left out. A family that fails becomes a candidate with model None and the
    failure's text. Raises ValueError for unknown loads."""
    names = check_loads(samples.scene.load_names, names)
    for family in (*METHODS, SPLINE):
        made = spline_candidates(samples, names) if family == SPLINE else regressor_candidates(family, samples, names)
        try:
            with one_thread():
                candidates = list(made)
        except Exception as error:  # a peer is someone else's method: whatever stops it is its entry in the table
            failure = " ".join(str(error).split()) or type(error).__name__
            candidates = [Candidate(Point(family, family, failure=failure))]
        yield from candidates


def run(
    scene: Annotated[str, typer.Argument(help="ready scene, or the path of a .toml")] = "knee",
    preset: Annotated[str, typer.Option(help="that of the build")] = DEFAULT_PRESET,
    out: Annotated[Path | None, typer.Option(help="the build's folder, if it has one of its own")] = None,
) -> None:
    """Measure the peers beside all else on the chart of a build, and draw it."""
    with progress_bars(PlainConsole()) as update:
        paths = chart(Project.open(scene, preset, out), peers=peer_candidates, update=update)
    print(*(f"written {path}" for path in paths), sep="\n")


if __name__ == "__main__":
    run_program(run)
