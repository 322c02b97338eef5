"""Peers: what one might use instead of these surrogates, fitted on the same samples and timed in the same run.

Run ``python -m problems.studies.peers knee --preset standard`` after that build.

Regressors of scikit-learn and SciPy (``pip install casadi_contact[peers]``), and a network with a history [EF15 §1]. A
predicted force that would pull is clamped to zero, as the paper does [EF15 §3.5]. Peers have no derivatives.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import comb
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import typer
from scipy.interpolate import RBFInterpolator

from casadi_contact.cli.options import DEFAULT_PRESET
from casadi_contact.cli.pipeline import chart
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array, as_poses
from casadi_contact.core.terminal import PlainConsole, progress_bars, run_program
from casadi_contact.core.workers import one_thread
from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.samples.samples import Samples
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.sample_rows import finite, fitted_rows
from casadi_contact.workflow.benchmark.candidates import Candidate
from casadi_contact.workflow.benchmark.front_file import Point
from casadi_contact.workflow.benchmark.timing import time_batch
from casadi_contact.workflow.project import Project
from problems.studies.history_models import Cycles, TimeDelay


@dataclass(frozen=True)
class TrainingSet:
    """Training rows in random order, so that the first n are a fair choice of n: poses (n, 6) and loads (n, L)."""

    scene: Scene
    load_names: tuple[str, ...]
    poses: Array
    loads: Array

    @classmethod
    def of(cls, samples: Samples, names: Sequence[str] | None = None, seed: int = 0) -> TrainingSet:
        """The training rows of samples; ValueError for an unknown load, NaN or no training rows."""
        names = tuple(samples.scene.load_names if names is None else names)
        rows, validation = fitted_rows(samples)
        poses, loads = finite("poses", samples.poses[rows]), finite("loads", samples.loads(names)[rows])
        order = np.random.default_rng(seed).permutation(np.flatnonzero(~validation))
        return cls(samples.scene, names, poses[order], loads[order])

    def __len__(self) -> int:
        return len(self.poses)

    def without_pull(self, loads: Array) -> Array:
        """Loads (n, L) with normal forces that would pull set to zero; magnitudes of forces have no such sign."""
        signs = {normal.loads[0]: normal.sign for normal in self.scene.normal_loads if normal.component is not None}
        sign = np.array([signs.get(name, 0.0) for name in self.load_names])
        return np.where(sign * loads < 0.0, 0.0, loads)


class Peer:
    """A fitted function poses (n, 6) -> loads (n, L) as a load model."""

    def __init__(self, predict: Callable[[Array], Array], data: TrainingSet) -> None:
        self.load_names, self._predict, self._data = data.load_names, predict, data

    def __call__(self, poses: Array) -> Array:
        """Named loads (n, L)."""
        return self._data.without_pull(np.reshape(self._predict(as_poses(poses)), (-1, len(self.load_names))))

    def one(self, pose: Array) -> Array:
        """Loads (L,) of one pose."""
        return cast(Array, self(np.reshape(pose, (1, 6)))[0])


class _RadialBasis:
    """SciPy's thin plate splines of standardised poses, with scikit-learn's ``fit`` and ``predict``; constant pose
    parameters are left out."""

    def __init__(self, neighbors: int | None) -> None:
        self.neighbors = neighbors

    def fit(self, x: Array, y: Array) -> _RadialBasis:
        """Thin plate splines have no shape parameter to tune."""
        self._varying = np.flatnonzero(np.ptp(x, axis=0) > 0.0)
        self._shift, self._scale = x[:, self._varying].mean(axis=0), x[:, self._varying].std(axis=0)
        self._interpolator = RBFInterpolator(self._inputs(x), y, neighbors=self.neighbors)
        return self

    def _inputs(self, x: Array) -> Array:
        return np.asarray((x[:, self._varying] - self._shift) / self._scale)

    def predict(self, x: Array) -> Array:
        """Values (n, L)."""
        return np.asarray(self._interpolator(self._inputs(x)))


def _scaled(*steps: Any) -> Any:
    """A pipeline that standardises poses first; ImportError that says what to install."""
    try:
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler
    except ImportError:
        raise ImportError("this peer needs scikit-learn: pip install casadi_contact[peers]") from None
    return make_pipeline(StandardScaler(), *steps)


def polynomials(data: TrainingSet, gflop: float) -> Iterator[tuple[str, Any, int]]:
    """Response surfaces of degree 2 to 6 by least squares, as far as there are more samples than terms."""
    from sklearn.linear_model import LinearRegression
    from sklearn.preprocessing import PolynomialFeatures

    for degree in (2, 3, 4, 5, 6):
        if comb(degree + 6, 6) <= len(data):
            yield f"{degree}", _scaled(PolynomialFeatures(degree), LinearRegression(fit_intercept=False)), len(data)


def gaussian_process(data: TrainingSet, gflop: float) -> Iterator[tuple[str, Any, int]]:
    """One process for all loads with a Matérn 5/2 kernel, one length for each parameter, and noise, on as many points
    as some 100 factorisations of n³/3 operations allow."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    count = min(len(data), int((gflop * 1e9 * 3.0 / 100.0) ** (1.0 / 3.0)))
    kernel = ConstantKernel(10.0) * Matern(np.full(6, 3.0), (0.1, 1e4), nu=2.5) + WhiteKernel(1e-6, (1e-10, 1.0))
    yield f"{count}", _scaled(GaussianProcessRegressor(kernel, normalize_y=True)), count


def neighbours(data: TrainingSet, gflop: float) -> Iterator[tuple[str, Any, int]]:
    """Means of the nearest samples, weighted by the inverse distance: lazy learning [EF15 §1] in its plainest form."""
    from sklearn.neighbors import KNeighborsRegressor

    yield "28", _scaled(KNeighborsRegressor(min(28, len(data)), weights="distance")), len(data)


def radial_basis(data: TrainingSet, gflop: float) -> Iterator[tuple[str, Any, int]]:
    """Thin plate splines: local ones on 100 neighbours of all samples, and one through as many as 2/3 n³ allows."""
    if len(data) > 100:
        yield "local 100", _RadialBasis(100), len(data)
    count = min(len(data), int((gflop * 1e9 * 1.5) ** (1.0 / 3.0)))
    yield f"{count}", _RadialBasis(None), count


REGRESSORS: dict[str, Callable[[TrainingSet, float], Iterator[tuple[str, Any, int]]]] = {
    "polynomial": polynomials,
    "Gaussian process": gaussian_process,
    "neighbours": neighbours,
    "radial basis": radial_basis,
}
"""By family: settings in words, estimator to fit, and number of samples that it takes."""


def fitted(data: TrainingSet, estimator: Any, count: int) -> Peer:
    """The estimator fitted on the first rows."""
    return Peer(estimator.fit(data.poses[:count], data.loads[:count]).predict, data)


def regressor_candidates(family: str, data: TrainingSet, gflop: float) -> Iterator[Candidate]:
    """The regressors of a family, fitted."""
    for settings, estimator, count in REGRESSORS[family](data, gflop):
        began = time.process_time()
        model = fitted(data, estimator, count)
        remark = "NumPy through scikit-learn; no derivatives; pulling forces clamped to zero"
        yield _candidate(f"{family} {settings}", family, model, count, time.process_time() - began, remark)


HISTORY = "time-delay network"


def history_candidates(
    data: TrainingSet, gflop: float, motion: ReferenceMotion | None, held_back: float = 0.15
) -> Iterator[Candidate]:
    """A time-delay network in sequence and on single poses, trained on the frames of the reference motion under the
    loads of the scene's teacher grid: samples have no order in time. held_back: share of cycles that stop the training.

    In sequence, poses are the frames of whole cycles, or of a piece of one. A single pose has no past: a motion that
    has rested there stands in for it. Raises ValueError without a motion of at least 2 cycles.
    """
    if motion is None or len(motion.poses) < 2:
        raise ValueError("a history model learns from cycles in order: give the reference motion, of at least 2 cycles")
    began, teacher = time.process_time(), ElasticFoundation(data.scene, data.scene.grids["teacher"])
    columns = [teacher.load_names.index(name) for name in data.load_names]
    loads = teacher(motion.poses.reshape(-1, 6))[:, columns].reshape(*motion.poses.shape[:2], -1)
    cycles = Cycles(motion.poses, loads, max(1, round(held_back * len(loads))))
    follow, frames = TimeDelay(cycles, gflop).follow, motion.poses.shape[1]
    took = time.process_time() - began

    def in_sequence(poses: Array) -> Array:
        return follow(poses.reshape(-1, frames if len(poses) % frames == 0 else len(poses), 6))

    def single(poses: Array) -> Array:
        return follow(poses[:, None])

    remark = "knows only the reference motion; no derivatives; pulling forces clamped to zero"
    for what, predict in (("in sequence", in_sequence), ("single poses", single)):
        learned = int((~cycles.validation).sum())
        yield _candidate(f"{HISTORY}, {what}", HISTORY, Peer(predict, data), learned, took, remark)


def _candidate(name: str, family: str, model: Peer, samples: int, seconds: float, remark: str) -> Candidate:
    def one_by_one(poses: Array) -> None:
        for pose in poses:
            model.one(pose)

    point = Point(name, family, samples=samples, training_seconds=seconds, remark=remark)
    return Candidate(point, model, {"value": partial(time_batch, one_by_one), "batch": partial(time_batch, model)})


FAMILIES = (*REGRESSORS, HISTORY)


def peer_candidates(
    samples: Samples,
    motion: ReferenceMotion | None,
    gflop: float,
    names: Sequence[str] | None = None,
    families: Sequence[str] = FAMILIES,
) -> Iterator[Candidate]:
    """Every peer, fitted on the training samples on one thread, one after the other.

    gflop: 10⁹ floating-point operations for each peer whose fit has a budget (Gaussian process, networks); counted and
    not timed, so that a busy machine gives the same peers. names: loads to predict, the scene's if left out. motion:
    what history models learn from. A family that fails becomes a candidate with model None and the failure's text.
    Raises ValueError for samples without training rows and for unknown loads.
    """
    data = TrainingSet.of(samples, names)
    for family in families:
        if family in REGRESSORS:
            candidates = regressor_candidates(family, data, gflop)
        else:
            candidates = history_candidates(data, gflop, motion)
        while True:
            try:
                with one_thread():
                    candidate = next(candidates)
            except StopIteration:
                break
            except Exception as error:  # a peer is someone else's method: whatever stops it is its entry in the table
                failure = " ".join(str(error).split()) or type(error).__name__
                yield Candidate(Point(family, family, failure=failure))
                break
            yield candidate


def run(
    scene: Annotated[str, typer.Argument(help="ready scene, or the path of a .toml, of a finished build")] = "knee",
    preset: Annotated[str, typer.Option(help="that of the build")] = DEFAULT_PRESET,
    out: Annotated[Path | None, typer.Option(help="the build's folder, if it has one of its own")] = None,
) -> None:
    """Measure the peers beside all else on the chart of a build, and draw it."""
    with progress_bars(PlainConsole()) as update:
        paths = chart(Project.open(scene, preset, out), peers=peer_candidates, update=update)
    print(*(f"written {path}" for path in paths), sep="\n")


def main() -> None:
    """Entry point: a user's mistake is one line on stderr."""
    run_program(run)


if __name__ == "__main__":
    main()
