"""A picture of an imported joint in one frame of a motion: bodies' surfaces shaded, the fixed ones in colours of
pressure, by rays from their triangles, and ligaments in those of their tension.

Polygons are drawn from far to near, so that near ones hide what lies behind.
"""

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import casadi_contact as cc
from casadi_contact.core.conventions import Array, rotation
from casadi_contact.core.terminal import run_program
from casadi_contact.optimisation.assembly.assembly import Assembly
from casadi_contact.optimisation.assembly.file import ray_casting
from casadi_contact.pictures.page import View, new_figure, save_page
from casadi_contact.scenes.opensim import TIME, read_opensim_table
from casadi_contact.scenes.shapes.mesh_bodies import body_mesh, patch_mesh
from casadi_contact.workflow.opensim_import.importing import states_of

_SIDES = ((-0.75, -0.25, -0.6), (0.75, -0.25, 0.6))  # looked along: from before and behind in an OpenSim model
_PRESSURE, _BARE, _TENSIONS = "YlOrRd", (0.87, 0.88, 0.9), ((0.0, "0.6"), (0.01, "#9ECAE1"), (1.0, "#08306B"))
_PIECES, _NEARER_MM, _WIDTH_MM = 24, 2.0, 1.4  # of a bundle, and how much nearer it counts than it is
_MARGIN_MM = 12.0, 30.0  # about surfaces, alone or with lines
_LEAST_N = 5.0  # of bundles named alike, for their name to be written
Painted = tuple[Array, Array]  # triangles (k, 3, 3) [mm] and their colours (k, 3)


def main(model: Path, motion: Path, at: float | None = None, out: Path = Path("results/knee_picture/knee.png")) -> None:
    """Draw an imported joint in one frame of a motion.

    model: the folder that `casadi-contact import` wrote; motion: all coordinates, .sto or .mot; at: time [s]; where the
    contacts press hardest, each in its own measure, if left out.
    """
    assembly, table = cc.load_assembly(model, contact=ray_casting), read_opensim_table(motion)
    q, time_s = states_of(assembly, table), table.columns[TIME]
    frame = int(np.abs(time_s - (at or 0.0)).argmin())
    if at is None:
        wrenches = np.asarray(assembly.function(["contact_wrenches"]).map(len(q))(q.T, 0.0, 0.0, 0.0))
        force = np.linalg.norm(wrenches.reshape(6, len(q), -1)[:3], axis=0)
        frame = int((force / np.maximum(force.max(axis=0), 1e-9)).sum(axis=1).argmax())
    out.parent.mkdir(parents=True, exist_ok=True)
    draw_assembly(assembly, q[frame], out)
    print(f"frame {frame}, {time_s[frame]:g} s, in {out}")


def draw_assembly(assembly: Assembly, q: Array, path: str | Path) -> None:
    """Write a picture of the assembly at q (n) [m, rad]: from two sides in the frame of the first contact's fixed body,
    and each fixed surface as its moving body sees it. Raises ValueError for contacts that are no meshes."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    function = assembly.function(["contact_poses", "ligament_tensions"])
    poses, tensions = (part.full() for part in function(q, 0.0, 0.0, 0.0))
    scenes = [contact.model.scene for contact in assembly.contacts]
    maps = [ray_casting(scene).pressure_maps(pose) for scene, pose in zip(scenes, poses.T, strict=True)]
    of_pressure = Normalize(0.0, max(float(each.pressures_mpa.max()) for of in maps for each in of))
    of_tension = Normalize(0.0, max(1.0, float(tensions.max(initial=0.0))))
    of_lines, place = LinearSegmentedColormap.from_list("tension", _TENSIONS), _places(assembly, q)

    fixed: list[Painted] = []
    moving: dict[str, Painted] = {}
    for contact, pressed in zip(assembly.contacts, maps, strict=True):
        geometry = contact.model.scene.geometry
        mpa = np.concatenate([each.pressures_mpa for each in pressed])[:, None]
        colours = np.where(mpa > 0.0, colormaps[_PRESSURE](of_pressure(mpa[:, 0]))[:, :3], _BARE)
        corners = np.concatenate([patch_mesh(geometry, each.patch).corners_mm for each in pressed])
        fixed.append((place(contact.fixed, corners, contact.fixed_frame), colours))
        corners = body_mesh(geometry, "moving").corners_mm
        moving[contact.moving] = place(contact.moving, corners, contact.moving_frame), np.tile(_BARE, (len(corners), 1))

    figure, most = new_figure(14.0, 11.0), len(fixed)
    grid = figure.add_gridspec(2, 2 * most, height_ratios=(1.6, 1.0))
    bundles = [
        np.stack([place(b, p) for b, p in zip(each.bodies, each.points_mm, strict=True)]) for each in assembly.ligaments
    ]
    for i, along in enumerate(_SIDES):
        axis, view = figure.add_subplot(grid[0, i * most : (i + 1) * most]), View.along(np.array(along))
        lines = [
            _line(points, _WIDTH_MM * (1.0 if tension > 0.1 else 0.4), of_lines(of_tension(tension))[:3], view)
            for points, tension in zip(bundles, tensions[:, 0], strict=True)
        ]
        _draw(axis, [_shaded(surface, view) for surface in (*fixed, *moving.values())], lines, view)
        _name_bundles(axis, assembly.ligament_names, bundles, tensions[:, 0], view)
    for i, (contact, surface, pressed) in enumerate(zip(assembly.contacts, fixed, maps, strict=True)):
        axis = figure.add_subplot(grid[1, 2 * i : 2 * i + 2])
        loads = np.concatenate([each.pressures_mpa for each in pressed]) + 1e-6
        view = View.along(-loads @ _normals(surface[0]))
        _draw(axis, [_shaded(surface, view)], [], view)
        force, peak = sum(each.forces_n.sum() for each in pressed), max(each.pressures_mpa.max() for each in pressed)
        axis.set_title(f"{contact.name}: {contact.fixed} as {contact.moving} sees it\n{force:.0f} N, {peak:.1f} MPa")
    look: dict[str, Any] = {"shrink": 0.8, "aspect": 30}
    figure.colorbar(ScalarMappable(of_tension, of_lines), ax=figure.axes[:2], label="tension of a bundle [N]", **look)
    figure.colorbar(ScalarMappable(of_pressure, _PRESSURE), ax=figure.axes[2:-1], label="pressure [MPa]", **look)
    save_page(figure, path, bbox_inches="tight")


def _places(assembly: Assembly, q: Array) -> Callable[..., Array]:
    """Function of a body, points (..., 3) and a frame (6,) on it: the points in the first contact's fixed body [mm]."""
    names = [assembly.contacts[0].fixed, *assembly.bodies]
    X = assembly.places(names)(q).full()
    bodies = {name: (X[:, 4 * i : 4 * i + 3], 1e3 * X[:, 4 * i + 3]) for i, name in enumerate(names)}
    bodies[assembly.ground] = np.eye(3), np.zeros(3)
    base = bodies[names[0]]

    def place(body: str, points_mm: Any, frame: Any = (0.0,) * 6) -> Array:
        inner = points_mm @ rotation(np.asarray(frame)[3:]).T + np.asarray(frame)[:3]
        return np.asarray((inner @ bodies[body][0].T + bodies[body][1] - base[1]) @ base[0])

    return place


def _seen(points_mm: Array, view: View) -> Array:
    """Rightwards, upwards and towards the viewer (..., 3)."""
    return points_mm @ np.stack([view.right.pointing, view.up.pointing, view.toward.pointing], axis=1)


def _shaded(surface: Painted, view: View) -> Painted:
    """Triangles in the light of the viewer, their backs darker."""
    corners, colours = _seen(surface[0], view), surface[1]
    normal = _normals(corners)
    facing = normal @ [0.25, 0.35, 0.9] / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
    return corners, colours * np.where(normal[:, 2] > 0.0, 0.45 + 0.55 * np.clip(facing, 0.0, 1.0), 0.75)[:, None]


def _normals(corners: Array) -> Array:
    """Of triangles (k, 3, 3), as long as twice their area."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _line(points_mm: Array, width_mm: float, colour: Any, view: View) -> Painted:
    """Short pieces (k, 4, 3) of a line through points (n, 3)."""
    at = np.linspace(0.0, len(points_mm) - 1.0, _PIECES + 1)
    points = _seen(np.stack([np.interp(at, np.arange(len(points_mm)), c) for c in points_mm.T], axis=1), view)
    along = np.diff(points[:, :2], axis=0)
    side = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    side = np.pad(0.5 * width_mm * side, ((0, 0), (0, 1)))
    start, end = (points[k : k + _PIECES] + np.array([0.0, 0.0, _NEARER_MM]) for k in (0, 1))
    return np.stack([start - side, end - side, end + side, start + side], axis=1), np.tile(colour, (_PIECES, 1))


def _draw(axis: Any, surfaces: list[Painted], lines: list[Painted], view: View) -> None:
    """Surfaces whole, lines as far as these reach and some more, and arrows of 10 mm along x, y and z."""
    from matplotlib.collections import PolyCollection

    painted = [*surfaces, *lines]
    polygons = [polygon for corners, _ in painted for polygon in corners]
    colours = np.concatenate([each for _, each in painted])
    order = np.argsort([polygon[:, 2].mean() for polygon in polygons], kind="stable")
    drawn = PolyCollection([polygons[i][:, :2] for i in order], facecolors=colours[order], edgecolors="face", lw=0.2)
    axis.add_collection(drawn)
    reach = np.concatenate([corners[..., :2].reshape(-1, 2) for corners, _ in surfaces])
    low, high = reach.min(axis=0) - _MARGIN_MM[bool(lines)], reach.max(axis=0) + _MARGIN_MM[bool(lines)]
    corner = low + np.array([4.0, 4.0])
    for letter, arrow in zip("xyz", 10.0 * _seen(np.eye(3), view)[:, :2], strict=True):
        if np.linalg.norm(arrow) > 3.0:
            look = {"arrowstyle": "<-", "color": "0.3"}
            axis.annotate(letter, corner, corner + arrow, arrowprops=look, color="0.3")
    axis.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axis.set_axis_off()


def _name_bundles(axis: Any, names: Sequence[str], bundles: list[Array], tensions: Array, view: View) -> None:
    """Names of taut bundles without their numbers, with their tension together, left and right of the picture."""
    top, named = axis.get_ylim()[1], []
    for name, group in itertools.groupby(range(len(names)), key=lambda i: names[i].rstrip("0123456789")):
        own = list(group)
        if (force := tensions[own].sum()) >= _LEAST_N:
            x, y, _ = np.mean([_seen(np.array([0.2, 0.8]) @ bundles[i][-2:], view) for i in own], axis=0)
            named.append((x, min(y, top), f"{name} {force:.0f} N"))
    halves = np.array_split(np.argsort([x for x, *_ in named]), 2)
    arrow, look = {"arrowstyle": "-", "lw": 0.6, "color": "0.4"}, {"textcoords": "axes fraction", "fontsize": 9}
    for half, edge, align in zip(halves, (-0.02, 1.02), ("right", "left"), strict=True):
        for number, i in enumerate(sorted(half, key=lambda i: named[i][1]), start=1):
            place = edge, number / (len(half) + 1)
            axis.annotate(named[i][2], named[i][:2], place, ha=align, arrowprops=arrow, **look)


if __name__ == "__main__":
    run_program(main)
