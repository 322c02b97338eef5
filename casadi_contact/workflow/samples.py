"""A project's samples: drawn from a contact model around the reference motion, or taken from a table."""

from collections.abc import Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path

from casadi_contact.core.conventions import Update, stage_progress
from casadi_contact.samples.draw import check_rejection_rate, draw_samples
from casadi_contact.samples.models import DrawnModel, model_name_of, model_pair, models_identity
from casadi_contact.samples.reference import reference_motion
from casadi_contact.samples.resume import KeptMotion, begun, check_same_plan, motion_origin
from casadi_contact.samples.samples import Samples, write_samples
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.samples.table import check_gaps, read_sample_table
from casadi_contact.scenes.walking import reference_motion_cycles
from casadi_contact.workflow.project import Project, exclusive, trained_surrogates


def check_single_source(table: str | Path | None, cycles: Sequence[str | Path], model: DrawnModel | str) -> None:
    """ValueError for cycles or another model beside a table of samples: nothing is drawn then."""
    if table is not None and (cycles or model != "elements"):
        raise ValueError(f"got a table of samples and {'cycles' if cycles else 'a model'}, expected one of them")


@exclusive
def sample(
    project: Project,
    cycle_files: Sequence[Path] = (),
    update: Update | None = None,
    executor: Executor | None = None,
    model: DrawnModel | str = "elements",
) -> tuple[Samples, str]:
    """Estimate the poses of the reference cycles and draw the samples, or go on where an earlier run stopped.

    cycle_files: measured cycles (§3.3); the built-in reference motion if empty. model: a name in `MODELS`, or a user's
    own contact model of the scene, which is evaluated in this process.

    Returns the samples and the report of the reference motion, which is kept beside the samples: a later call goes on
    around it.

    Raises ValueError for samples or surrogates of something else in the folder, where more of a domain was dropped than
    the settings' ``most_dropped`` and for gaps of the wrong sign (the file is kept).
    """
    models = model_pair(model)
    if not isinstance(model, str) and model.scene.digest != project.scene.digest:
        raise ValueError(f"the model stands for another scene than {project.scene.name}: make it for this one")
    trained_surrogates(project)
    cycles = reference_motion_cycles(project.scene, cycle_files)
    settings = SamplingSettings.from_scene(
        project.scene, scale=project.preset.sampling_scale, **project.preset.sampling
    )
    origin = motion_origin(project.scene, cycles, settings, models_identity(models))
    drawn = begun(project.samples_path)
    if drawn is not None and project.motion_path.is_file():
        kept = KeptMotion.read(project.motion_path, project.scene.pose_space)
        check_same_plan(kept.origin, origin, drawn)
    else:
        settled_on, progress = models(project.scene, settings)[0], stage_progress(update, "reference motion")
        motion, report = reference_motion(settled_on, cycles, settings, progress)
        kept = KeptMotion(motion, str(report), tuple(map(str, cycle_files)), origin)
        kept.write(project.motion_path)
    progress = stage_progress(update, "samples")
    with nullcontext(executor) if isinstance(model, str) else ThreadPoolExecutor(1) as workers:
        samples = draw_samples(
            project.scene,
            kept.motion,
            project.samples_path,
            settings=settings,
            executor=workers,
            models=models,
            progress=progress,
        )
    check_rejection_rate(samples, settings.most_dropped)
    if model_name_of(samples) is None:
        check_gaps(samples, str(project.samples_path))
    return samples, kept.report


@exclusive
def take_table(project: Project, table: Path) -> Samples:
    """Make the samples file from a table of samples (`dataset.read_sample_table`) instead of drawing them.

    Raises ValueError for a folder in which other samples are drawn or learned already.
    """
    samples = read_sample_table(table, project.scene)
    if project.samples_path.is_file():
        there = project.samples().provenance
        learned = (project.folder / "training").exists() or trained_surrogates(project)
        if there.get("table_digest") != samples.provenance["table_digest"] and (learned or "table" not in there):
            changed = f"was made from {table} as it was before" if there.get("table") == str(table) else "is of others"
            raise ValueError(f"{project.samples_path} {changed}: choose another --out, or remove that folder")
    project.motion_path.unlink(missing_ok=True)  # of a draw that was left for the table
    write_samples(project.samples_path, samples)
    return samples
