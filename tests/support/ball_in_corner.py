"""A ball in the corner of a floor at y = 0 and a wall across x = 0, of mesh files, and what a plane carries of it."""

from pathlib import Path

import numpy as np

from tests.support.meshes import ELASTIC, ball_mesh, post_mesh, write_obj

RADIUS_MM = 8.0


def write_corner(folder: Path) -> Path:
    """The folder with post.obj (fixed) and ball.obj (moving) in it."""
    write_obj(folder / "post.obj", *post_mesh())
    write_obj(folder / "ball.obj", *ball_mesh(RADIUS_MM, 0.5))
    return folder


def force_n(overlap_mm: float) -> float:
    """π·K/h·d²·(R - d/3): a ball on a plane, depth along the plane's normal."""
    nu = ELASTIC["poissons_ratio"]
    modulus = (1.0 - nu) * ELASTIC["youngs_modulus"] / ((1.0 + nu) * (1.0 - 2.0 * nu))
    return float(np.pi * modulus / ELASTIC["thickness"] * overlap_mm**2 * (RADIUS_MM - overlap_mm / 3.0))
