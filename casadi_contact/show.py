"""Pictures of contact: the pressure on the fixed surface seen from above, and the moving surface in section.

A wrong sign or frame shows here first.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from casadi_contact.contact import ElasticFoundation
from casadi_contact.conventions import POSE_NAMES, Array, as_poses, load_unit
from casadi_contact.files import replacing
from casadi_contact.geometry import body_field

MOST_FRAMES = 8
_NEUTRAL_OVERLAP_MM = 0.1
_FARTHEST_MM = 150.0
_SECTION_POINTS = 300
_MARGIN_MM = 8.0  # of a section beyond the elements


def read_poses(path: str | Path) -> Array:
    """Poses (n, 6) of a CSV file with the columns tx, ty, tz [mm], rx, ry, rz [rad]; others are ignored.

    Raises FileNotFoundError, or ValueError for missing columns or values that are no numbers.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"pose file {path} does not exist")
    try:
        table = np.atleast_1d(np.genfromtxt(path, delimiter=",", names=True, encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path} is not a table of poses ({str(error).splitlines()[0]})") from None
    missing = [name for name in POSE_NAMES if name not in (table.dtype.names or ())]
    if missing or not len(table):
        raise ValueError(f"{path} lacks {', '.join(missing) or 'rows'}, expected the columns {', '.join(POSE_NAMES)}")
    return as_poses(np.stack([table[name] for name in POSE_NAMES], axis=1))


def neutral_pose(model: ElasticFoundation) -> Array:
    """The scene's start pose (6,), moved along the direction of pressing until the bodies overlap by 0.1 mm.

    Raises ValueError where there is no single direction, or it never brings them together.
    """
    scene = model.scene
    direction = scene.normal_loads[0].direction
    if direction is None:
        raise ValueError(f"scene {scene.name} is pressed along no single direction, expected a pose of yours")

    def posed(travel_mm: Array) -> Array:
        return scene.start_pose - np.pad(travel_mm[:, None] * direction, ((0, 0), (0, 3)))

    travel = np.linspace(_FARTHEST_MM, -_FARTHEST_MM, 151)
    touching = np.flatnonzero(model.gaps(posed(travel)).min(axis=1) < -_NEUTRAL_OVERLAP_MM)
    if not touching.size or touching[0] == 0:
        raise ValueError(f"scene {scene.name} has no neutral pose along the direction of pressing: give a pose")
    low, high = travel[touching[0]], travel[touching[0] - 1]
    for _ in range(40):
        middle = 0.5 * (low + high)
        deep = model.gaps(posed(np.array([middle]))).min() < -_NEUTRAL_OVERLAP_MM
        low, high = (middle, high) if deep else (low, middle)
    return posed(np.array([low]))[0]


def surface_fits(model: ElasticFoundation) -> list[str]:
    """How well the smooth surfaces of a mesh scene fit its meshes, a line for each; none for other scenes."""
    if model.scene.shape != "mesh":
        return []
    return [f"{body}: {body_field(model.scene, body).fit}" for body in ("moving", "fixed")]


def draw_contact(model: ElasticFoundation, poses: Array, path: str | Path) -> None:
    """Write a picture of one pose, or a strip of up to MOST_FRAMES of several poses (n, 6), evenly spaced."""
    poses = as_poses(poses)
    chosen = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), MOST_FRAMES)).round().astype(int))
    figure = _one(model, poses[0]) if len(poses) == 1 else _strip(model, poses[chosen], chosen)
    with replacing(Path(path)) as beside:
        figure.savefig(beside, format=Path(path).suffix[1:] or "png", dpi=130)


def _figure(width: float, height: float) -> Any:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _one(model: ElasticFoundation, pose: Array) -> Any:
    maps = model.pressure_maps(pose)
    figure = _figure(5.0 + 4.5 * len(maps), 4.2)
    axes = figure.subplots(1, 1 + len(maps), width_ratios=[1.0] + [0.9] * len(maps))
    dots = _seen_from_above(axes[0], maps, _largest([maps]))
    figure.colorbar(dots, ax=axes[0], label="pressure [MPa]", shrink=0.8)
    axes[0].set_title("fixed surface from above")
    for axis, pressed in zip(axes[1:], maps, strict=True):
        _section(axis, model, pose, pressed)
    loads = zip(model.load_names, model(pose[None])[0], strict=True)
    said = ", ".join(f"{name} {value:.0f} {load_unit(name)}" for name, value in loads)
    at = ", ".join(f"{name} {value:.4g}" for name, value in zip(POSE_NAMES, pose, strict=True))
    figure.suptitle(f"{model.scene.name}: {at}\n{said}", fontsize=9)
    return figure


def _strip(model: ElasticFoundation, poses: Array, numbers: np.ndarray) -> Any:
    frames = [model.pressure_maps(pose) for pose in poses]
    figure = _figure(2.2 * len(frames) + 1.0, 2.6)
    axes = figure.subplots(1, len(frames), sharex=True, sharey=True)
    for axis, maps, number in zip(axes, frames, numbers, strict=True):
        dots = _seen_from_above(axis, maps, _largest(frames))
        axis.set_title(f"frame {number}", fontsize=9)
        axis.label_outer()
    figure.colorbar(dots, ax=axes, label="pressure [MPa]", shrink=0.8)
    figure.suptitle(model.scene.name, fontsize=9)
    return figure


def _largest(frames: list[Any]) -> float:
    return max((float(m.pressures_mpa.max(initial=0.0)) for maps in frames for m in maps), default=0.0) or 1.0


def _seen_from_above(axis: Any, maps: list[Any], largest: float) -> Any:
    """Every element in its colour (grey: no contact); + at each patch's centre of pressure."""
    for pressed in maps:
        x, _, z = pressed.centres_mm.T
        size = 1.2 * np.sqrt(np.median(pressed.areas_mm2))
        axis.scatter(z, x, s=size, c="0.85", linewidths=0)
        loaded = pressed.pressures_mpa > 0.0
        dots = axis.scatter(
            z[loaded], x[loaded], s=4 * size, c=pressed.pressures_mpa[loaded], vmin=0.0, vmax=largest, linewidths=0
        )
        axis.annotate(pressed.patch, (z.mean(), x.max()), ha="center", va="bottom", fontsize=8)
        if (centre := pressed.centre_mm) is not None:
            axis.plot(centre[2], centre[0], "+", color="red", markersize=10)
    axis.set(aspect="equal", xlabel="z [mm]", ylabel="x [mm]")
    return dots


def _section(axis: Any, model: ElasticFoundation, pose: Array, pressed: Any) -> None:
    """The plane z = const. through the patch's centre of pressure (its middle out of contact)."""
    centres = pressed.centres_mm
    z = float(np.median(centres[:, 2]) if pressed.centre_mm is None else pressed.centre_mm[2])
    near = np.abs(centres[:, 2] - z)
    column = centres[near <= near.min() + 0.5 * np.sqrt(np.median(pressed.areas_mm2))]
    low, high = column.min(axis=0) - _MARGIN_MM, column.max(axis=0) + _MARGIN_MM
    high[1] = max(high[1], low[1] + 0.6 * (high[0] - low[0]))
    x, y = np.meshgrid(np.linspace(low[0], high[0], _SECTION_POINTS), np.linspace(low[1], high[1], _SECTION_POINTS))
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=1)
    distance = model.distances(points, pose, pressed.patch).reshape(x.shape)
    axis.contourf(x, y, distance, levels=[-1e3, 0.0], colors=["tab:blue"], alpha=0.25)
    axis.contour(x, y, distance, levels=[0.0], colors=["tab:blue"])
    axis.plot(*column[np.argsort(column[:, 0])][:, :2].T, color="tab:orange")
    axis.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    axis.set_title(f"{pressed.patch}: section at z = {z:.1f} mm", fontsize=9)
