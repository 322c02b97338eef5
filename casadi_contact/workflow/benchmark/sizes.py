"""The surrogates on the speed-accuracy chart: a ladder of sizes, and one size with fewer samples or other budgets."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from casadi_contact.core.conventions import Update
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.workers import worker_pool
from casadi_contact.networks.network import size_text
from casadi_contact.samples.samples import COLUMNS, TEST, Samples
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.info import samples_record
from casadi_contact.surrogate.load import load_surrogate
from casadi_contact.surrogate.registry import STRUCTURES
from casadi_contact.workflow.benchmark.front_file import SAMPLES, SECONDS, SIZE
from casadi_contact.workflow.fitting import Fitting, fit_surrogate
from casadi_contact.workflow.presets import ChartEffort, Effort
from casadi_contact.workflow.project import Project, alone

_OF_SAMPLES = ("samples", "pose_range", "load_range")  # what a record tells of those that were learned


@dataclass(frozen=True)
class Sized:
    """A surrogate to train: structure, effort (see `project.presets.Effort`), samples learned from (None: all), the
    sweep of the chart it belongs to, and the seed of its random weights."""

    structure: str
    effort: Effort
    samples: int | None = None
    sweep: str = SIZE
    seed: int = 0

    @property
    def name(self) -> str:
        """Name on the chart: "patch 12-12", "patch 12-12 (300 samples)", "patch 12-12 (45 Gflop)"."""
        extra = {SIZE: "", SAMPLES: f" ({self.samples} samples)", SECONDS: f" ({self.effort.gflop:g} Gflop)"}[
            self.sweep
        ]
        again = f" (seed {self.seed})" if self.seed else ""
        return f"{self.structure} {size_text(self.effort.sizes[-1])}{extra}{again}"

    @property
    def stem(self) -> str:
        """Name of its file and of its folder of checkpoints."""
        return self.name.replace("(", "").replace(")", "").replace(" ", "_")

    @property
    def efforts(self) -> dict[str, Effort]:
        """Effort by the start of a network's name, with the structure's shares of the budget."""
        shares = {"": 1.0, **STRUCTURES[self.structure].budget_shares}
        return {name: replace(self.effort, gflop=share * self.effort.gflop) for name, share in shares.items()}


def chart_surrogates(chart: ChartEffort, scene: Scene) -> list[Sized]:
    """Every surrogate that a preset's chart shows, sizes first, of the structures that fit the scene."""
    fitting = {structure: efforts for structure, efforts in chart.sizes.items() if STRUCTURES[structure].fits(scene)}
    sizes = [Sized(structure, effort) for structure, efforts in fitting.items() for effort in efforts]
    structure, size = chart.swept
    swept = [sized for sized in sizes if sized.structure == structure and sized.effort.sizes == (size,)]
    return [
        *sizes,
        *(replace(sized, samples=count, sweep=SAMPLES) for sized in swept for count in chart.sample_counts),
        *(
            replace(sized, effort=replace(sized.effort, gflop=gflop), sweep=SECONDS)
            for sized in swept
            for gflop in chart.training_gflop
        ),
    ]


def sized_path(project: Project, sized: Sized, loads: Sequence[str] | None = None) -> Path:
    """Where a sized surrogate lies in the project's folder; one with the networks of some loads says so."""
    only = "" if loads is None else "_for_" + "_".join(loads)
    return project.folder / "sizes" / f"{sized.stem}{only}.h5"


def on_disk(project: Project, path: Path | str, learned: Samples | None = None) -> Surrogate | None:
    """The surrogate at a path or of a shipped name, or None where there is none of this scene that can be read, or, of
    samples that it is to have learned, one whose record tells of others."""
    try:
        surrogate = load_surrogate(path)
    except (FileNotFoundError, ValueError):  # damaged or of an older format: made again, from its checkpoints
        return None
    known = {} if learned is None else samples_record(learned)
    same = all(surrogate.record.get(key) == known[key] for key in _OF_SAMPLES if key in known)
    return surrogate if same and surrogate.scene.digest == project.scene.digest else None


def _made(project: Project, path: Path, learned: Samples) -> bool:
    """Whether a surrogate lies there that was trained on these samples for the tolerances of now."""
    surrogate = on_disk(project, path, learned)
    return surrogate is not None and surrogate.scene.tolerances == project.scene.tolerances


def subset_of(samples: Samples, count: int | None) -> Samples:
    """All test rows and a random `count` of the others ([EF15 §3.5] fits a random subset), in their order."""
    learned = np.flatnonzero(samples.role != TEST)
    if count is None or count >= len(learned):
        return samples
    kept = np.flatnonzero(samples.role == TEST)
    kept = np.sort(np.append(kept, np.random.default_rng(0).choice(learned, count, replace=False)))
    columns = {name: getattr(samples, name)[kept] for name in COLUMNS}
    return Samples(samples.scene, **columns, provenance=samples.provenance)


@alone
def train_sizes(
    project: Project,
    wanted: Sequence[Sized] | None = None,
    update: Update | None = None,
    executor: Executor | None = None,
    loads: Sequence[str] | None = None,
) -> list[Path]:
    """Train the sized surrogates (the preset's, if none are given) that are not on disk yet; return their paths.

    Goes on from checkpoints where an earlier run stopped. loads: train only the networks that these need. Raises
    FileNotFoundError without samples, ValueError for samples of another scene.
    """
    wanted = chart_surrogates(project.preset.chart, project.scene) if wanted is None else list(wanted)
    samples = replace(project.samples(), scene=project.scene)  # its tolerances are those of now
    missing = [
        sized
        for sized in wanted
        if not _made(project, sized_path(project, sized, loads), subset_of(samples, sized.samples))
    ]
    if missing:
        writable_folder(project.folder / "sizes")
        command = project.command("chart")
        with worker_pool(executor) as workers:
            for sized in missing:
                folder = project.training_folder("sizes", sized.stem)
                fitting = Fitting(
                    sized.structure, sized.efforts, folder, command, sized.name, loads=loads, seed=sized.seed
                )
                surrogate = fit_surrogate(project, subset_of(samples, sized.samples), fitting, update, workers)
                surrogate.save(sized_path(project, sized, loads))
    return [sized_path(project, sized, loads) for sized in wanted]
