"""Meshes of bodies with known distance, and scenes of mesh files, as text."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import casadi_contact as cc

for library in ("trimesh", "embreex", "igl"):
    pytest.importorskip(library, reason="meshes need the extra: pip install casadi_contact[mesh]")

ELASTIC = {"youngs_modulus": 463.0, "poissons_ratio": 0.46, "thickness": 8.0, "law": '"linear"'}
STIFFNESS = 267.5728  # K/h of it [N/mm³]


def cap_mesh(radius, edge, angle):
    """The part of a sphere within an angle of -y, of nearly equilateral triangles: vertices, faces."""
    count = int(4.0 * np.pi * radius**2 / (np.sqrt(3.0) / 2.0 * edge**2))
    k = np.arange(count) + 0.5
    polar, azimuth = np.arccos(1.0 - 2.0 * k / count), np.pi * (1.0 + 5.0**0.5) * k
    rng = np.random.default_rng(0)
    points = np.stack([np.cos(azimuth) * np.sin(polar), -np.cos(polar), np.sin(azimuth) * np.sin(polar)], axis=1)
    points += 0.1 * edge / radius * rng.standard_normal(points.shape)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces = outward(radius * points, ConvexHull(points).simplices, lambda p: p)
    kept = faces[(points[faces][..., 1] < -np.cos(angle)).all(axis=1)]
    return radius * points, kept


def torus_mesh(ring, tube, edge):
    """A closed torus about the z axis, its grid of triangles jittered: vertices, faces."""
    nu, nv = int(2.0 * np.pi * (ring + tube) / edge), int(2.0 * np.pi * tube / edge)
    rng = np.random.default_rng(1)
    u, v = np.meshgrid(2.0 * np.pi * np.arange(nu) / nu, 2.0 * np.pi * np.arange(nv) / nv, indexing="ij")
    u, v = u + 0.6 / nu * rng.standard_normal(u.shape), v + 0.6 / nv * rng.standard_normal(u.shape)
    rho = ring + tube * np.cos(v)
    points = np.stack([rho * np.cos(u), rho * np.sin(u), tube * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(nu), np.arange(nv), indexing="ij"))

    def at(a, b):
        return (a % nu) * nv + b % nv

    faces = np.concatenate(
        [
            np.stack([at(i, j), at(i + 1, j), at(i + 1, j + 1)], axis=1),
            np.stack([at(i, j), at(i + 1, j + 1), at(i, j + 1)], axis=1),
        ]
    )
    return points, outward(points, faces, lambda p: p - ring * unit(p * [1.0, 1.0, 0.0]))


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def outward(points, faces, direction):
    """The faces, turned to run anticlockwise seen from where `direction` (of their centres) points."""
    a, b, c = np.moveaxis(points[faces], 1, 0)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), direction((a + b + c) / 3.0)) < 0.0
    return np.where(inward[:, None], faces[:, ::-1], faces)


def sheet_mesh(side, step, height=lambda x, z: 0.0 * x):
    """The surface y = height(x, z) over a square, facing +y: vertices, faces."""
    n = round(side / step) + 1
    x, z = np.meshgrid(np.linspace(-side / 2.0, side / 2.0, n), np.linspace(-side / 2.0, side / 2.0, n), indexing="ij")
    points = np.stack([x, height(x, z), z], axis=-1).reshape(-1, 3)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(n - 1), np.arange(n - 1), indexing="ij"))
    a = i * n + j
    faces = np.concatenate([np.stack([a, a + 1, a + n], axis=1), np.stack([a + 1, a + n + 1, a + n], axis=1)])
    return points, faces


def slab_mesh(vertices, faces, thickness):
    """A sheet as the top of a closed body, its back as deep below (along y), joined by a rim."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    codes, times = np.unique(np.sort(sides, axis=1) @ [len(vertices), 1], return_counts=True)
    a, b = sides[np.isin(np.sort(sides, axis=1) @ [len(vertices), 1], codes[times == 1])].T
    far = len(vertices)
    rim = [np.stack([b, a, a + far], axis=1), np.stack([b, a + far, b + far], axis=1)]
    return np.vstack([vertices, vertices - [0.0, thickness, 0.0]]), np.concatenate([faces, faces[:, ::-1] + far, *rim])


def write_obj(path, vertices, faces):
    lines = [*("v {:.10f} {:.10f} {:.10f}".format(*v) for v in vertices), *("f {} {} {}".format(*f) for f in faces + 1)]
    path.write_text("\n".join(lines) + "\n")


def mesh_scene_text(moving, fixed, *, units="mm", elements="grid", material=None, extra="", grid=(80, 40)):
    """A scene file of two meshes as one patch (or as `extra` says)."""
    material = ELASTIC if material is None else material
    patches = "" if "[geometry.patches" in extra else "[geometry.patches.contact]\n"
    layer = "\n".join(f"{key} = {value}" for key, value in material.items())
    grids = "\n".join(f"{name} = [{grid[0]}, {grid[1]}]" for name in ("fine", "coarse", "settle", "teacher"))
    names = '["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]'
    tolerances = "\n".join(f"{name} = 1.0" for name in ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"))
    return f"""format = 1
name = "meshes"
shape = "mesh"
[geometry]
moving = "{moving}"
fixed = "{fixed}"
units = "{units}"
elements = "{elements}"
{extra}
{patches}[material]
{layer}
[grids]
{grids}
[loads]
names = {names}
sensitive = ["Fy"]
sensitive_pose = ["ty"]
reference_load = 1000.0
gap_slope = 7.5
boundary_load = 5.0
[tolerances]
{tolerances}
"""


def ground_scene_text(fixed):
    """A scene file of a mesh that the ground presses from below."""
    text = mesh_scene_text(
        "ground", fixed, extra="pressing = [0.0, 1.0, 0.0]\nstart_pose = [0.0, -20.0, 0.0, 0.0, 0.0, 0.0]"
    )
    text = text.replace('"mesh"', '"mesh_on_ground"').replace('moving = "ground"\n', "")
    return text.replace('sensitive = ["Fy"]', 'sensitive = ["+Fy"]')


def scene_of(folder, moving, fixed, **settings):
    """The scene of two meshes (vertices, faces), whose files are written to a folder; settings as `mesh_scene_text`."""
    for name, mesh in (("moving.obj", moving), ("fixed.obj", fixed)):
        write_obj(folder / name, *mesh)
    (folder / "scene.toml").write_text(mesh_scene_text("moving.obj", "fixed.obj", **settings))
    return cc.load_scene(folder / "scene.toml")


def revolved(profile, around):
    """The surface that a profile (n, 2) of (r, y) draws about y, facing to the right of its way: vertices, faces."""
    r, y = np.asarray(profile, dtype=float).T
    angle = 2.0 * np.pi * np.arange(around) / around
    sides = [np.outer(r, np.cos(angle)), np.outer(y, np.ones(around)), np.outer(r, np.sin(angle))]
    points = np.stack(sides, axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(len(r), around)
    number[r == 0.0] = number[r == 0.0, :1]
    a, b = number[:-1], number[1:]
    c, d = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    faces = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([c, b, d], axis=-1)]).reshape(-1, 3)
    used, faces = np.unique(faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)], return_inverse=True)
    return points[used], faces.reshape(-1, 3)


def shell_mesh(inner, outer, edge, angle, pole):
    """A closed cup: spheres of two radii within an angle of the pole, joined by a rim; its inside faces the centre."""
    polar = angle * np.linspace(0.0, 1.0, max(6, int(outer * angle / edge)) + 1)
    arc = np.stack([np.sin(polar), np.cos(polar)], axis=1)
    profile = np.vstack([inner * arc, outer * arc[::-1]])
    points, faces = revolved(profile, max(24, int(2.0 * np.pi * outer / edge)))
    return points @ turn_to(pole).T, faces


def turn_to(pole):
    """R (3, 3) that turns y to the pole."""
    up = unit(np.asarray(pole, dtype=float))
    first = unit(np.cross(up, [0.0, 0.0, 1.0]))
    return np.stack([first, up, np.cross(first, up)], axis=1)


def ball_mesh(radius, edge):
    """A closed sphere about the origin."""
    return cap_mesh(radius, edge, np.pi)


def with_slid_vertex(vertices, faces, by_mm):
    """The lowest vertex moved sideways on its sphere, over its neighbours, where two triangles come to face inwards."""
    vertices, lowest = vertices.copy(), int(vertices[:, 1].argmin())
    radius = np.linalg.norm(vertices[lowest])
    vertices[lowest, 0] += by_mm
    vertices[lowest] *= radius / np.linalg.norm(vertices[lowest])
    return vertices, faces


def groove(x, z):
    """A valley along x with straight sides that rise by 0.5, rounded over 4 mm, for `sheet_mesh`."""
    return 0.5 * (np.sqrt(z**2 + 4.0**2) - 4.0) + 0.0 * x


def wheel_mesh(radius, half_width, edge):
    """A closed cylinder about the z axis, with sharp edges: vertices, faces."""
    across = np.linspace(-half_width, half_width, max(2, round(2.0 * half_width / edge)) + 1)
    profile = [(0.0, -half_width), *((radius, z) for z in across), (0.0, half_width)]
    points, faces = revolved(profile, round(2.0 * np.pi * radius / edge))
    return points[:, [0, 2, 1]] * [1.0, 1.0, -1.0], faces


def post_mesh():
    """A closed L, 40 mm wide: a floor at y = 0 for x > 0 that ends at a wall of 16 mm across x = 0, as from CAD."""
    outline = np.array([(0.0, 16.0), (0.0, 0.0), (30.0, 0.0), (30.0, -8.0), (-10.0, -8.0), (-10.0, 16.0)])
    n = len(outline)
    points = np.array([[x, y, z] for z in (-20.0, 20.0) for x, y in outline])
    front = np.array([[0, 1, 5], [1, 4, 5], [1, 2, 4], [2, 3, 4]])
    i, j = np.arange(n), np.roll(np.arange(n), -1)
    sides = [np.stack([i, j, i + n], axis=1), np.stack([j, j + n, i + n], axis=1)]
    faces = np.concatenate([*sides, front[:, ::-1], front + n])
    volume = np.einsum("ij,ij->", points[faces[:, 0]], np.cross(points[faces[:, 1]], points[faces[:, 2]]))
    return points, faces if volume > 0.0 else faces[:, ::-1]


RADIUS_MM = 8.0


def write_corner(folder: Path) -> Path:
    """The folder with post.obj (fixed) and ball.obj (moving) in it."""
    write_obj(folder / "post.obj", *post_mesh())
    write_obj(folder / "ball.obj", *ball_mesh(RADIUS_MM, 0.5))
    return folder


def force_n(overlap_mm: float) -> float:
    """π·K/h·d²·(R - d/3): a ball on a plane, depth along the plane's normal."""
    return float(np.pi * STIFFNESS * overlap_mm**2 * (RADIUS_MM - overlap_mm / 3.0))
