"""Drawing samples: inputs -> settle on a coarse grid -> evaluate on the teacher grid, in chunks [EF15 §2.4, §3.3].

Chunks go through any `concurrent.futures.Executor`. A chunk's samples depend on nothing but its inputs, so the
samples are the same for every executor and number of workers, and after a kill and a rerun.
"""

import json
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import WRENCH_NAMES, Array, Progress, evenly_spaced_indices
from casadi_contact.core.workers import cancelled_if_left, one_thread, worker_pool
from casadi_contact.samples.chunk import Chunk, DrawnChunk, draw_chunk, plan_chunks, plan_digest, wrenches_of
from casadi_contact.samples.domains import left_out
from casadi_contact.samples.models import (
    MODELS,
    ModelPair,
    elastic_foundations,
    foundations,
    model_name,
    models_identity,
    settings_of,
)
from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.samples.resume import ChunkFolder, check_same_plan
from casadi_contact.samples.samples import (
    COLUMNS,
    DOMAINS,
    Dropped,
    Samples,
    partial_folder,
    read_samples,
    write_samples,
)
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.scene import Scene


@lru_cache(maxsize=2)
def _worker_models(
    scene_toml: str, settings_json: str, models: ModelPair
) -> tuple[ContactModel, ContactModel, SamplingSettings]:
    """The models to settle and to evaluate on, made once in each process, and the settings."""
    settings = SamplingSettings(**json.loads(settings_json))
    return *models(Scene.from_toml(scene_toml), settings), settings


def draw_samples(
    scene: Scene,
    motion: ReferenceMotion,
    path: str | Path,
    *,
    settings: SamplingSettings | None = None,
    executor: Executor | None = None,
    models: ModelPair = elastic_foundations,
    progress: Progress | None = None,
) -> Samples:
    """Draw the whole sampling plan into the HDF5 file `path`, or finish it where an earlier run was killed.

    executor: processes on all cores if left out; models: an importable function that makes the two contact models.

    Samples that do not settle, that pull, or that touch where they should be lifted off are dropped and counted with
    the reason in provenance["dropped"]; domains that the plan leaves out stand in provenance["left_out"]. Raises
    ValueError if `path` holds samples of another plan, or of a user's own model that has changed since.
    """
    path = Path(path)
    settings = SamplingSettings.from_scene(scene) if settings is None else settings
    chunks = plan_chunks(scene, motion, settings)
    identity = {"scene": scene.digest, "settings": settings.to_table(), **models_identity(models)}
    identity["plan_digest"] = plan_digest(chunks)
    if models is foundations:  # chosen for the scene's tolerances
        identity["tolerances"] = dict(scene.tolerances)
    worker = (scene.to_toml(), json.dumps(settings.to_table(), sort_keys=True), models)

    def check(before: Samples, where: Path) -> None:
        if model_name(models) not in MODELS:  # the library's are known by name, version and settings
            check_same_model(_worker_models(*worker)[1], before, where)

    if path.exists():
        samples = read_samples(path)
        check_same_plan({**samples.provenance, "scene": samples.scene.digest}, identity, path)
        check(replace(samples, scene=scene), path)
        shutil.rmtree(partial_folder(path), ignore_errors=True)  # left where a kill came just before the clearing up
        return samples
    folder = ChunkFolder(path, identity)
    drawn = {number: chunk for number in range(len(chunks)) if (chunk := folder.read(number)) is not None}
    if drawn:
        check(joined_chunks(scene, drawn.values()), folder.folder)
    _draw_missing(partial(_draw, *worker), chunks, drawn, folder, executor, progress or (lambda done, total: None))
    samples = _gather(scene, chunks, [drawn[number] for number in range(len(chunks))], identity, settings)
    write_samples(path, samples)
    shutil.rmtree(folder.folder)
    return samples


def check_same_model(model: ContactModel, samples: Samples, where: Path) -> None:
    """Raise ValueError where a user's model gives other loads than samples drawn from it.

    At up to 10 samples with a load each may differ by its tolerance, or by 1 % of the largest force (torque), RMS.
    """
    loaded = np.flatnonzero((samples.wrenches != 0.0).any(axis=(1, 2)))
    before = samples.rows(loaded[evenly_spaced_indices(len(loaded), 10)] if len(loaded) else loaded)
    now = replace(before, wrenches=wrenches_of(model, before.poses, len(before.scene.patches)))
    size = np.repeat(np.abs(before.wrenches).reshape(-1, 2, 3).max(axis=(0, 2), initial=0.0), 3)
    for name, off in zip(before.scene.load_names, (now.loads() - before.loads()).T, strict=True):
        limit = max(before.scene.tolerances[name], 0.01 * size[WRENCH_NAMES.index(name.partition("_")[0])])
        rms = float(np.sqrt(np.mean(off**2))) if len(off) else 0.0
        if not rms <= limit:
            got = f"{name} differs by {rms:.3g} RMS, expected at most {limit:.3g}"
            raise ValueError(f"{where} was drawn from another contact model: {got}: give the same one, or delete it")


def check_rejection_rate(samples: Samples, most: float) -> None:
    """Raise ValueError where more than the share `most` of a domain's plan became no samples, with the reasons."""
    for domain, share in samples.dropped_shares().items():
        if share > most:
            got = f"{share:.1%} of the samples of {domain} were dropped, expected at most {most:.1%}"
            cure = "mend patches or loads, draw closer to the motion (d3_fraction, d2_offset), or allow most_dropped"
            raise ValueError(f"{got}: {samples.dropped_reasons(domain)}. They are kept: {cure}")


def _draw_missing(
    job: Callable[[Chunk], DrawnChunk],
    chunks: Sequence[Chunk],
    drawn: dict[int, DrawnChunk],
    folder: ChunkFolder,
    executor: Executor | None,
    progress: Progress,
) -> None:
    """Draw the chunks that are not among those drawn, by number, and add each to them and to the folder as it comes."""
    progress(len(drawn), len(chunks))
    missing = [number for number in range(len(chunks)) if number not in drawn]
    if not missing:
        return
    with worker_pool(executor) as workers:
        futures = {workers.submit(job, chunks[number]): number for number in missing}
        with cancelled_if_left(workers, futures):
            for future in as_completed(futures):
                try:
                    chunk = future.result()
                except Exception as error:
                    error.add_note(f"{len(drawn)} of {len(chunks)} chunks of samples are kept in {folder.folder}")
                    raise
                drawn[futures[future]] = chunk
                folder.write(futures[future], chunk)
                progress(len(drawn), len(chunks))


def _draw(scene_toml: str, settings_json: str, models: ModelPair, chunk: Chunk) -> DrawnChunk:
    """Draw one chunk; runs in a worker, and on one thread: the executor already uses all cores."""
    with one_thread():
        settle_model, teacher, settings = _worker_models(scene_toml, settings_json, models)
        return draw_chunk(settle_model, teacher, chunk, settings)


def teacher_job(samples: Samples) -> Callable[[Array], Array]:
    """Wrenches (n, patches, 6) of poses (n, 6) on the samples' model, as a worker finds them: it makes it once."""
    settings = json.dumps(settings_of(samples).to_table(), sort_keys=True)
    return partial(_evaluate, samples.scene.to_toml(), settings, MODELS[samples.provenance["models"]])


def _evaluate(scene_toml: str, settings_json: str, models: ModelPair, poses: Array) -> Array:
    with one_thread():
        settle_model, teacher, _ = _worker_models(scene_toml, settings_json, models)
        return wrenches_of(teacher, poses, len(settle_model.scene.patches))


def joined_chunks(scene: Scene, drawn: Iterable[DrawnChunk]) -> Samples:
    """The samples of these chunks, without provenance."""
    columns: dict[str, Any] = {name: np.concatenate([getattr(chunk, name) for chunk in drawn]) for name in COLUMNS}
    return Samples(scene, **columns)


def _gather(
    scene: Scene, chunks: list[Chunk], drawn: list[DrawnChunk], identity: dict[str, Any], settings: SamplingSettings
) -> Samples:
    """All chunks as one set of samples, with provenance."""
    dropped: dict[str, Counter[str]] = {}
    for asked, got in zip(chunks, drawn, strict=True):
        if got.dropped:
            dropped.setdefault(DOMAINS[asked.domain - 1], Counter()).update(got.dropped)
    of_plan = {name: value for name, value in identity.items() if name != "scene"}
    skipped = left_out(scene.controllable_normal_loads, settings)
    provenance = {**of_plan, "dropped": dropped, "left_out": skipped}
    lost_from = np.repeat([chunk.domain for chunk in chunks], [len(chunk.dropped_poses) for chunk in drawn])
    lost = Dropped(np.concatenate([chunk.dropped_poses for chunk in drawn]), lost_from)
    return replace(joined_chunks(scene, drawn), provenance=provenance, dropped=lost)
