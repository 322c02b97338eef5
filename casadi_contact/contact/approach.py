"""Bringing a body into contact: towards the first touch, and from there until it carries a force."""

from collections.abc import Callable, Mapping

import numpy as np

from casadi_contact.contact.model import ContactModel
from casadi_contact.core.conventions import Array, rotation


def loading_directions(model: ContactModel, count: int, target: Mapping[str, Array]) -> Array:
    """Unit vectors (count, 3) along which bodies go into contact: that of the first patch's normal load or, where this
    has none, the target force (n,) by load names. Raises ValueError where that force is not among the targets."""
    normal = model.scene.normal_loads[0]
    if normal.direction is not None:
        return np.tile(normal.direction, (count, 1))
    missing = [name for name in normal.loads if name not in target]
    if missing:
        raise ValueError(f"there is no load {', '.join(missing)}, expected the force that presses the patch")
    along: Array = np.stack([target[name] for name in normal.loads], axis=1)
    return along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)


def advance_to_contact(model: ContactModel, poses: Array, target: Mapping[str, Array]) -> Array:
    """Poses (n, 6) moved along `loading_directions` until the first touch, within the scene's pose space.

    Where the scene has a loading direction bodies start a metre away, else from where they are; a pose that overlaps
    at first stays. Raises ValueError for a model without gaps, and like `loading_directions`.
    """
    if not model.has_gaps:
        raise ValueError("this contact model has no gaps(poses), expected a start pose in contact")
    poses, space = poses.copy(), model.scene.pose_space
    along, direction = loading_directions(model, len(poses), target), model.scene.normal_loads[0].direction
    if direction is not None:
        axis = int(np.abs(direction).argmax())
        poses[:, axis] = -1000.0 * direction[axis]

    def moved(rows: np.ndarray, travel_mm: Array) -> Array:
        after = poses[rows]
        after[:, :3] += travel_mm[:, None] * along[rows]
        return space.project(after)

    everyone = np.arange(len(poses))
    by_travel = moved(everyone, np.ones(len(poses))) - moved(everyone, np.zeros(len(poses)))
    speed = np.maximum(np.linalg.norm(by_travel[:, :3], axis=1), 1.0)  # tied parameters move along

    def gap_at(rows: np.ndarray, travel_mm: Array) -> Array:
        return np.asarray(model.gaps(moved(rows, travel_mm)).min(axis=1) / speed[rows])

    return moved(everyone, trace_gap(gap_at, len(poses))[0])


def trace_gap(
    gap_at: Callable[[np.ndarray, Array], Array],
    count: int,
    *,
    reach_mm: float = 1e4,
    touch_mm: float = 1e-3,
    share: float = 1.0,
    most_steps: int = 200,
) -> tuple[Array, np.ndarray]:
    """Travel (count,) [mm] of bodies until their gap is below touch_mm, and (count,) whether it gets there.

    gap_at(rows (k,), travel (k,)) gives the gaps (k,) of those rows. Each step is a share of the gap, so that it does
    not pass the surface (sphere tracing). Where an estimated gap led too deep, half of the last way is taken back.
    """
    travel, since_free = np.zeros(count), np.zeros(count)
    touching, moving = np.zeros(count, dtype=bool), np.arange(count)
    for _ in range(most_steps):
        if not len(moving):
            break
        gap = gap_at(moving, travel[moving])
        since_free[moving] = np.where(gap >= 0.0, 0.0, since_free[moving])
        step = np.where(gap < -touch_mm, -0.5 * since_free[moving], share * np.maximum(gap, 0.0))
        touching[moving] = gap < touch_mm
        moving, step = moving[np.abs(step) >= share * touch_mm], step[np.abs(step) >= share * touch_mm]
        travel[moving] += step
        since_free[moving] += step
        moving = moving[travel[moving] < reach_mm]
    return travel, touching


def first_crossing(
    holds: Callable[[np.ndarray, Array], np.ndarray], count: int, step: float, reach: float, bisections: int = 12
) -> Array:
    """Travel (count,) at which a condition begins to hold, to step/2^bisections; reach where it does not by then.
    Marches outwards in equal steps, then bisects; less than a step may be missed. holds(rows (k,), travel (k,)): (k,).
    """
    far, searching = np.zeros(count), np.arange(count)
    while len(searching):
        far[searching] = np.minimum(far[searching] + step, reach)
        searching = searching[~holds(searching, far[searching]) & (far[searching] < reach)]
    near, everyone = np.maximum(far - step, 0.0), np.arange(count)
    for _ in range(bisections if count else 0):
        middle = 0.5 * (near + far)
        inside = holds(everyone, middle)
        near, far = np.where(inside, near, middle), np.where(inside, middle, far)
    return far


def press_until(
    force_of: Callable[[Array], Array],
    touching: Array,
    along: Array,
    target_n: Array,
    depth_mm: float,
    rounds: int = 6,
    most_change: float = 3.0,
) -> tuple[Array, Array]:
    """Poses (n, 6) moved along directions (n, 3) until force_of(poses) (n,) [N] is about the target, and that force.

    Contact forces grow about as the square of the depth: d ← d·√(F*/F), at most by the factor most_change.
    """
    poses, force, depth = touching, np.zeros(len(target_n)), np.full(len(target_n), depth_mm)
    for _ in range(rounds):
        poses = touching + np.pad(depth[:, None] * along, ((0, 0), (0, 3)))
        force = force_of(poses)
        ratio = np.sqrt(target_n / np.maximum(force, target_n / most_change**4))
        depth = depth * np.clip(ratio, 1.0 / most_change, most_change)
    return poses, force


def touching_start(model: ContactModel) -> Array:
    """The first touch (6,) from the scene's start pose; that pose itself without gaps or loading direction."""
    start = model.scene.pose_space.project(model.scene.start_pose)
    directed = model.scene.normal_loads[0].direction is not None
    return advance_to_contact(model, start[None], {})[0] if directed and model.has_gaps else start


def rotate_about_anchors(model: ContactModel, start: Array, poses: Array) -> Array:
    """Poses (n, 6) that keep their rotations, moved so that the middle of the patches' anchors lies where it does in a
    start pose (6,): a body whose origin is far from its contact would leave its socket if it turned about the origin.
    """
    middle, poses = model.scene.anchors_mm.mean(axis=0), poses.copy()
    poses[:, :3] = start[:3] + (rotation(start[3:]) - rotation(poses[:, 3:])) @ middle
    return poses
