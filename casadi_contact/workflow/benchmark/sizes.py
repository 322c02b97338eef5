"""The surrogates on the speed-accuracy chart: a ladder of sizes."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

from casadi_contact.core.conventions import Update
from casadi_contact.core.files.writing import writable_folder
from casadi_contact.core.workers import worker_pool
from casadi_contact.networks.network import size_text
from casadi_contact.samples.samples import Samples
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.load import STRUCTURES, load_surrogate
from casadi_contact.surrogate.sample_rows import samples_record
from casadi_contact.workflow.fitting import Fitting, fit_surrogate
from casadi_contact.workflow.presets import ChartEffort, Effort
from casadi_contact.workflow.project import Project, exclusive

_OF_SAMPLES = ("samples", "pose_range", "load_range")  # what a record tells of those that were learned


@dataclass(frozen=True)
class Sized:
    """A surrogate to train: structure and effort (see `project.presets.Effort`)."""

    structure: str
    effort: Effort

    @property
    def name(self) -> str:
        """Name on the chart: "patch 12-12"."""
        return f"{self.structure} {size_text(self.effort.sizes[-1])}"

    @property
    def stem(self) -> str:
        """Name of its file and of its folder of checkpoints."""
        return self.name.replace(" ", "_")

    @property
    def efforts(self) -> dict[str, Effort]:
        """Effort by the start of a network's name, with the structure's shares of the budget."""
        shares = {"": 1.0, **STRUCTURES[self.structure].budget_shares}
        return {name: replace(self.effort, gflop=share * self.effort.gflop) for name, share in shares.items()}


def chart_surrogates(chart: ChartEffort, scene: Scene) -> list[Sized]:
    """Every surrogate that a preset's chart shows, of the structures that fit the scene."""
    fitting = {structure: efforts for structure, efforts in chart.sizes.items() if STRUCTURES[structure].fits(scene)}
    return [Sized(structure, effort) for structure, efforts in fitting.items() for effort in efforts]


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


@exclusive
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
    missing = [sized for sized in wanted if not _made(project, sized_path(project, sized, loads), samples)]
    if missing:
        writable_folder(project.folder / "sizes")
        command = project.command("chart")
        with worker_pool(executor) as workers:
            for sized in missing:
                folder = project.training_folder("sizes", sized.stem)
                fitting = Fitting(sized.structure, sized.efforts, folder, command, sized.name, loads=loads)
                surrogate = fit_surrogate(project, samples, fitting, update, workers)
                surrogate.save(sized_path(project, sized, loads))
    return [sized_path(project, sized, loads) for sized in wanted]
