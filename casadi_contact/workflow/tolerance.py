"""A surrogate no larger than a tolerance asks for: samples, networks and work grow until it is met in every domain.

Round k draws twice the samples of the round before and lets each network grow with three times the work to a closer
fit. The first round whose validation rows have errors within four fifths of the tolerance, load by load and domain by
domain, is the last: the result depends on the scene and the tolerance, not on the clock. Of the last round that there
is, errors within the tolerance itself are enough. The networks that met it are then made as small as they may be
(`project.smallest`).
"""

from __future__ import annotations

import itertools
import logging
import shutil
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

from casadi_contact.core.conventions import Update
from casadi_contact.core.files.reading import sha256_of
from casadi_contact.core.files.writing import replacing, write_text
from casadi_contact.core.quantities import FORCE, TORQUE, of_kind, three_digits
from casadi_contact.core.workers import worker_pool
from casadi_contact.samples.errors import LoadModel, domain_errors
from casadi_contact.samples.models import ModelPair, elastic_foundations, teacher_of
from casadi_contact.samples.samples import TEST, VALIDATION, Samples, partial_folder
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.tolerance import Tolerance
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.calibration import with_trust
from casadi_contact.surrogate.patch.surrogate import PatchSurrogate
from casadi_contact.workflow.fitting import Fitting, fit_surrogate
from casadi_contact.workflow.presets import Effort, Preset, effort_for
from casadi_contact.workflow.project import Project, alone, surrogates_made
from casadi_contact.workflow.samples import sample
from casadi_contact.workflow.smallest import smallest_networks
from casadi_contact.workflow.train import build_command, moved_samples

STRUCTURE = PatchSurrogate.structure
ROUNDS = 6
FIRST_SCALE, FIRST_GFLOP = 0.1, 60.0
LADDER = ((8,), (8, 8), (12, 12), (16, 16), (16, 16, 16), (20, 20, 20), (24, 24, 24), (28, 28, 28))
TOLERANCE_SHARE = 0.6  # of the tolerance at which a fit ends: domains differ, and so do rows it has not seen
CLOSER = 0.7  # times that share in each further round

MET = 0.8  # of the tolerance on validation rows: a few hundred rows of a domain do not tell its error closer
_ROUNDS = "within"  # begins the name of the folder of the rounds
_COPIED = "samples-within.sha256"  # of the samples that come from the last round

_log = logging.getLogger(__name__)


def scene_to_tolerance(scene: Scene, force_n: float | None, torque_nmm: float | None) -> Scene:
    """The scene with one tolerance for all forces [N] and one for all torques [N·mm]; its own where None.

    Raises ValueError for a tolerance that is not above 0, and for one of a kind of load that the scene has not.
    """
    Tolerance.of_kinds(force_n, torque_nmm)
    wanted: dict[str, float] = {}
    for kind, value in ((FORCE, force_n), (TORQUE, torque_nmm)):
        if value is None:
            continue
        names = of_kind(scene.load_names, kind)
        if not names:
            raise ValueError(
                f"got a {kind.name} tolerance, but the loads of scene {scene.name} are {', '.join(scene.load_names)}: "
                "leave it out"
            )
        wanted |= dict.fromkeys(names, value)
    return scene.with_tolerances(**wanted)


def _options(scene: Scene) -> list[str]:
    """What asks for the scene's tolerances on the command line: of each kind of load whose tolerances are all one."""
    options = []
    for kind, option in ((FORCE, "--force-tol"), (TORQUE, "--torque-tol")):
        values = {scene.tolerances[name] for name in of_kind(scene.load_names, kind)}
        options += [option, f"{values.pop():.15g}"] if len(values) == 1 else []
    return options


def misses(model: LoadModel, samples: Samples, most: float = MET, role: int = VALIDATION) -> list[str]:
    """Loads whose RMS error on validation rows (or those of another role) of a domain exceeds this share of the scene's
    tolerance, in words, the worst first."""
    found = {}
    for domain, errors in domain_errors(model, samples, role).items():
        tolerance = Tolerance.of(samples.scene, tuple(errors)).times(most)
        ratios = tolerance.rms_ratios([error["rms"] for error in errors.values()])
        for (load, error), ratio, allowed in zip(errors.items(), ratios, tolerance.allowed, strict=True):
            if ratio > 1.0:
                found[f"{load} {three_digits(error['rms'])} of {allowed:g} in {domain}"] = ratio
    return sorted(found, key=lambda text: -found[text])


def _refuse_others(project: Project) -> None:
    """ValueError for samples or surrogates in the folder that were not copied there from rounds."""
    surrogates_made(project)
    if project.samples_path.is_file():
        project.samples()
        digest, kept = sha256_of(project.samples_path), project.folder / _COPIED
        rounds = project.folder.glob(f"{_ROUNDS}-*/round-*/{project.samples_path.name}")
        others = digest not in (kept.read_text("utf-8") if kept.is_file() else "", *map(sha256_of, rounds))
    else:
        others = project.begun or partial_folder(project.samples_path).is_dir()
    if others:
        raise ValueError(
            f"{project.folder} holds samples or surrogates that no build to a tolerance made, expected none: they "
            "would be replaced; choose another --out"
        )


@alone
def train_to_tolerance(
    project: Project,
    cycle_files: Sequence[Path] = (),
    update: Update | None = None,
    executor: Executor | None = None,
    models: ModelPair = elastic_foundations,
    rounds: int = ROUNDS,
) -> Surrogate:
    """Sample and train in rounds until the tolerances of the project's scene are met, within `MET` of them on
    validation rows and at all on held-back ones; samples and surrogate of the last round go into the project's folder.

    Goes on where an earlier run stopped. Raises
    ValueError, naming the largest misses, where the last round does not meet them; its samples and surrogate are kept
    all the same. A ValueError also refuses a folder with samples or surrogates that no such build of this scene made:
    they would be replaced.
    """
    efforts = {
        "": Effort(LADDER, PatchSurrogate.budget_shares["ratios"] * FIRST_GFLOP, tolerance_share=TOLERANCE_SHARE),
        "root": Effort(LADDER, FIRST_GFLOP, tolerance_share=TOLERANCE_SHARE),
    }
    _refuse_others(project)
    missed: list[str] = []
    rounds_folder = project.folder / "-".join([_ROUNDS, *(f"{tol:.15g}" for tol in project.scene.tolerances.values())])
    for k in range(rounds):
        preset = Preset(FIRST_SCALE * 2**k, {STRUCTURE: efforts})
        this = replace(project, folder=rounds_folder / f"round-{k + 1}", own=preset)
        this.folder.mkdir(parents=True, exist_ok=True)
        samples, _ = sample(this, cycle_files, _in_round(update, k + 1), executor, models)
        with worker_pool(executor) as workers:
            folder, title = this.folder / "training", f"round {k + 1}"
            cycles = [str(path) for path in cycle_files]
            command = build_command(project, samples, cycles, *_options(project.scene))
            fitting = Fitting(STRUCTURE, efforts, folder, command, title)
            surrogate = fit_surrogate(this, samples, fitting, update, workers)
            share = MET if k + 1 < rounds else 1.0
            missed = misses(surrogate, samples, share) or misses(surrogate, samples, 1.0, TEST)
            if not missed:
                surrogate = _smallest(surrogate, this, samples, fitting, share, update, workers)
                break
        _log.warning("round %d misses %s", k + 1, "; ".join(missed[:3]))
        efforts = {name: _further(effort) for name, effort in efforts.items()}
    for name in (this.samples_path.name, this.motion_path.name):
        with replacing(project.folder / name) as beside:
            shutil.copyfile(this.folder / name, beside)
    write_text(project.folder / _COPIED, sha256_of(project.samples_path))
    teacher = teacher_of(samples)
    trusted = with_trust(surrogate, samples, moved_samples(samples, teacher, update), teacher, update)
    trusted.save(project.surrogate_path(STRUCTURE))
    if missed:
        raise ValueError(
            f"after {rounds} rounds, {len(samples)} samples, the tolerance is missed: {'; '.join(missed[:3])}; "
            "loosen it, or ask for fewer loads or a smaller range"
        )
    return trusted


def _smallest(
    surrogate: Surrogate,
    project: Project,
    samples: Samples,
    fitting: Fitting,
    share: float,
    update: Update | None,
    executor: Executor | None,
) -> Surrogate:
    """The surrogate with networks as small as validation rows allow; itself where held-back rows then miss."""
    steps = itertools.count(1)

    def fitted(sizes: Mapping[str, tuple[int, ...]], before: Surrogate) -> Surrogate:
        anew = replace(
            fitting,
            efforts={name: replace(effort_for(fitting.efforts, name), sizes=(size,)) for name, size in sizes.items()},
            checkpoints=fitting.checkpoints / f"smaller-{next(steps)}",
            title=f"{fitting.title}, smaller",
            kept={name: network for name, network in before.networks.items() if name not in sizes},
        )
        return fit_surrogate(project, samples, anew, update, executor)

    small = smallest_networks(surrogate, samples, LADDER, fitted, lambda model: not misses(model, samples, share))
    if missed := misses(small, samples, 1.0, TEST):
        _log.warning("smaller networks miss %s of held-back rows: the larger ones stay", missed[0])
        return surrogate
    return small


def _in_round(update: Update | None, number: int) -> Update | None:
    return None if update is None else lambda what, *rest: update(f"{what}, round {number}", *rest)


def _further(effort: Effort) -> Effort:
    """Three times the work, and a closer fit: the last may have met its share."""
    return replace(effort, gflop=3.0 * effort.gflop, tolerance_share=CLOSER * effort.tolerance_share)
