"""One chunk of a sampling plan: settle on a coarse grid, lift off, evaluate on the teacher grid [EF15 §2.4, §3.3]."""

import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from casadi_contact.contact.approach import advance_to_contact
from casadi_contact.contact.model import ContactModel
from casadi_contact.contact.settle import NOT_FINITE, settle
from casadi_contact.core.conventions import POSE_IN_MM, Array, pose_index
from casadi_contact.samples.domains import plan_domains
from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.samples.samples import DOMAINS
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.normal_load import normal_forces
from casadi_contact.scenes.scene import Scene

_PULL_N = 1e-9


@dataclass(frozen=True)
class Chunk:
    """Static analyses of one domain: start poses (n, 6), target loads (n,) by name, role (n,); lifted as in `Block`."""

    domain: int
    lifted: int
    free: tuple[str, ...]
    starts: Array
    loads: dict[str, Array]
    role: np.ndarray


@dataclass(frozen=True)
class DrawnChunk:
    """Samples of one chunk, as in `Samples`; rejected poses (m, 6), and their number by reason."""

    poses: Array
    wrenches: Array
    gaps: Array
    domain: np.ndarray
    role: np.ndarray
    dropped_poses: Array
    dropped: Mapping[str, int]


def plan_chunks(scene: Scene, motion: ReferenceMotion, settings: SamplingSettings) -> list[Chunk]:
    """The sampling plan in chunks of at most `chunk_size` static analyses; ValueError for one that cannot be drawn."""
    chunks = []
    point = motion.point
    normals = scene.controllable_normal_loads if point.free else [n.as_number for n in scene.normal_loads]
    for block in plan_domains(motion.envelopes, normals, scene.boundary_load, settings, not point.free):
        starts = motion.starts(block.inputs)
        for k in range(0, len(block.inputs), settings.chunk_size):
            rows = slice(k, k + settings.chunk_size)
            loads = {name: block.inputs[rows, point.inputs.index(name)] for name in point.load_inputs}
            chunks.append(Chunk(block.domain, block.lifted, point.free, starts[rows], loads, block.role[rows]))
    return chunks


def plan_digest(chunks: list[Chunk]) -> str:
    """SHA-256 of all chunks of a plan."""
    digest = hashlib.sha256()
    for chunk in chunks:
        digest.update(repr((chunk.domain, chunk.lifted, chunk.free, sorted(chunk.loads))).encode())
        for array in (chunk.starts, *(chunk.loads[name] for name in sorted(chunk.loads)), chunk.role):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


@dataclass
class _Drawn:
    """Poses (n, 6) not yet evaluated with their role (n,), and the rejected ones, counted by reason."""

    poses: Array
    role: np.ndarray
    lost: list[Array] = field(default_factory=list)
    dropped: Counter[str] = field(default_factory=Counter)

    def drop(self, reasons: np.ndarray) -> None:
        """Reject poses with a reason (n,), "" for none."""
        good = np.asarray(reasons == "")
        self.dropped.update(map(str, reasons[~good]))
        self.lost.append(self.poses[~good])
        self.poses, self.role = self.poses[good], self.role[good]


def draw_chunk(
    settle_model: ContactModel, teacher: ContactModel, chunk: Chunk, settings: SamplingSettings
) -> DrawnChunk:
    """Settle, lift off (D4, D5), evaluate and check the samples of one chunk."""
    drawn, scene = _settled(settle_model, chunk, settings), settle_model.scene
    if len(drawn.poses) and chunk.free:  # of known poses, edges belong to the motion
        beyond = edge_share(teacher, drawn.poses) > settings.most_edge_share
        drawn.drop(np.where(beyond, "load at the edge of the elements", ""))
    wrenches, gaps = (of(teacher, drawn.poses, len(scene.patches)) for of in (wrenches_of, gaps_of))
    lifted = {"D4": [chunk.lifted], "D5": list(range(len(scene.patches)))}.get(DOMAINS[chunk.domain - 1], [])
    touching = (wrenches[:, lifted] != 0.0).any(axis=(1, 2))
    pulls = (normal_forces(scene.normal_loads, wrenches) < -_PULL_N).any(axis=1)
    finite = np.isfinite(wrenches).all(axis=(1, 2))
    reasons = np.select([~finite, pulls, touching], [NOT_FINITE, "pulls", "touches though lifted off"], "")
    good = reasons == ""
    drawn.drop(reasons)
    domain, lost = np.full(len(drawn.poses), chunk.domain, dtype=np.uint8), np.concatenate(drawn.lost)
    return DrawnChunk(drawn.poses, wrenches[good], gaps[good], domain, drawn.role, lost, drawn.dropped)


def _settled(model: ContactModel, chunk: Chunk, settings: SamplingSettings) -> _Drawn:
    """The chunk's poses settled under their loads; those of D4 and D5 then lifted off in several steps."""
    if chunk.free:
        # The whole reach has no reference pose nearby to start from.
        starts = advance_to_contact(model, chunk.starts, chunk.loads) if settings.reach else chunk.starts
        poses, report = settle(model, starts, chunk.free, chunk.loads, tolerance=settings.settle_tolerance_n)
        reasons = np.array([why and f"not settled: {why.partition(':')[0]}" for why in report.reason], dtype=object)
    else:
        poses = pressed(model, chunk.starts, chunk.loads)
        known = np.asarray(np.isfinite(poses).all(axis=1))
        poses, reasons = np.where(known[:, None], poses, chunk.starts), np.where(known, "", "not pressed")
    drawn = _Drawn(poses, chunk.role)
    drawn.drop(reasons)
    if DOMAINS[chunk.domain - 1] in ("D4", "D5"):
        lifted = _lifted(model, drawn.poses, chunk, settings)
        known = np.asarray(np.isfinite(lifted).all(axis=2))
        drawn.poses = np.where(known[..., None], lifted, drawn.poses[:, None]).reshape(-1, 6)
        drawn.role = np.repeat(drawn.role, settings.liftoff_steps)
        drawn.drop(np.where(known.ravel(), "", "not lifted off"))
    return drawn


def pressed(model: ContactModel, poses: Array, loads: Mapping[str, Array]) -> Array:
    """Poses (n, 6) moved as little as it takes until patches carry normal loads (n,), in their order; NaN as `lift`."""
    roots = np.sqrt(np.abs(np.stack([*loads.values()], axis=1)) / model.scene.reference_load)
    return lift(model, poses, np.full(roots.shape, np.nan), roots)


def _lifted(model: ContactModel, poses: Array, chunk: Chunk, settings: SamplingSettings) -> Array:
    """Poses (n, steps, 6) of D4 and D5, in equal steps up to `liftoff_mm`. D4 lifts one patch while the others keep
    their loads, D5 all patches alike [EF15 §3.3]. In the plan `reach`, D5 lifts each patch by a random gap of its own:
    networks that never saw one patch just off and another farther out predicted thousands of newtons there."""
    steps, scene = settings.liftoff_steps, model.scene
    each, patches = np.repeat(poses, steps, axis=0), len(scene.normal_loads)
    shares = np.tile(np.arange(1, steps + 1) / steps, len(poses))
    gaps = settings.liftoff_mm * np.repeat(shares[:, None], patches, axis=1)
    if chunk.lifted >= 0:
        gaps[:, np.arange(patches) != chunk.lifted] = np.nan
    elif settings.reach and len(scene.sensitive_pose) == patches:
        rng = np.random.default_rng([settings.seed, DOMAINS.index("D5")])
        gaps = rng.uniform(0.0, settings.liftoff_mm, gaps.shape)
    return lift(model, each, gaps).reshape(len(poses), steps, 6)


def lift(
    model: ContactModel, poses: Array, gaps_mm: Array, kept_roots: Array | None = None, newton_steps: int = 8
) -> Array:
    """Move poses (n, 6) along the sensitive pose parameters, of a scene that names none along all, until patches are
    gaps_mm (n, P) away; NaN keeps the load, or gives the patch that of kept_roots (n, P).

    Newton's method on the root loads, which are -c·gap out of contact; those of a model without gaps are continued
    there along their slope at the start. Steps are of least squares, turns at 25 mm, 1 mm long or as the widest gap.
    Returns poses (n, 6): NaN where loads or slopes are not finite, where all slopes are zero, and where a kept load
    ends more than 0.1 % off.
    """
    scene = model.scene
    columns = [pose_index(name) for name in scene.sensitive_pose or scene.pose_space.free_names]
    size, most_mm = 1.0 / POSE_IN_MM[columns], np.nanmax(gaps_mm, initial=1.0)
    begin, rise = model.root_loads(poses)
    per_mm = scene.gap_slope if model.has_gaps else np.linalg.norm(rise[..., :3], axis=2)
    kept, usable = np.isnan(gaps_mm), np.ones(len(poses), dtype=bool)
    given = begin if kept_roots is None else kept_roots
    wanted, found = np.where(kept, given, -per_mm * np.nan_to_num(gaps_mm)), poses.copy()
    for step in range(newton_steps + 1):
        s, slope = model.root_loads(found)
        if not model.has_gaps:
            off = s <= 0.0
            s = np.where(off, begin + np.einsum("npk,nk->np", rise, found - poses), s)
            slope = np.where(off[..., None], rise, slope)
        if step == newton_steps:
            break
        by_pose = scene.pose_space.pull_back(slope)[..., columns] * size
        finite = np.isfinite(by_pose).all(axis=(1, 2)) & np.isfinite(s).all(axis=1)
        usable &= finite & (by_pose != 0.0).any(axis=(1, 2))
        moves = (np.linalg.pinv(by_pose[usable]) @ (wanted - s)[usable][..., None])[..., 0]
        moves *= np.minimum(1.0, most_mm / np.maximum(np.linalg.norm(moves, axis=1, keepdims=True), 1e-300))
        found[np.ix_(np.flatnonzero(usable), np.array(columns))] += size * moves
    usable &= (~kept | (np.abs(s - wanted) <= 1e-3 * np.abs(wanted))).all(axis=1)
    found = scene.pose_space.project(found)
    found[~usable] = np.nan
    return found


def edge_share(teacher: ContactModel, poses: Array) -> Array:
    """The largest share of a patch's load (n,) at edges: the model's edge_share, else 1 where contact is at_edge."""
    share = getattr(teacher, "edge_share", teacher.at_edge)
    return np.asarray(share(poses).max(axis=1).astype(float))


def wrenches_of(teacher: ContactModel, poses: Array, patches: int) -> Array:
    """Wrenches (n, patches, 6); a user's own model need not accept no poses."""
    return teacher.wrenches(poses) if len(poses) else np.zeros((0, patches, 6))


def gaps_of(teacher: ContactModel, poses: Array, patches: int) -> Array:
    """Gaps (n, patches), NaN for a model without gaps."""
    known = teacher.has_gaps and len(poses)
    return teacher.gaps(poses) if known else np.full((len(poses), patches), np.nan)
