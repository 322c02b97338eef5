"""Flat faces as CAD exports them: few large triangles that run out into a fillet of many small ones."""

import numpy as np
import pytest

import casadi_contact as cc
from tests.support.meshes import STIFFNESS, mesh_scene_text, outward, sheet_mesh, write_obj

FLAT, FILLET, SPOKES = 12.0, 2.0, 60


def button_mesh(strips):
    """A closed round button: below a flat face of triangles as long as it is wide, a fillet round it, above a lid."""
    angle = np.linspace(0.0, 0.5 * np.pi, strips + 1)
    radius, height = FLAT + FILLET * np.sin(angle), FILLET * (1.0 - np.cos(angle))
    radius, height = np.append(radius, FLAT + FILLET), np.append(height, 8.0)
    azimuth = 2.0 * np.pi * np.arange(SPOKES) / SPOKES
    rings = [
        np.stack([r * np.cos(azimuth), 0.0 * azimuth + y, r * np.sin(azimuth)], axis=1)
        for r, y in zip(radius, height, strict=True)
    ]
    k, following = np.arange(SPOKES), (np.arange(SPOKES) + 1) % SPOKES
    last = SPOKES * (len(rings) - 1)
    faces = [np.stack([0 * k, k + 2, following + 2], axis=1)]
    faces += [np.stack([0 * k + 1, k + last + 2, following + last + 2], axis=1)]
    for first in 2 + SPOKES * np.arange(len(rings) - 1):
        a, b = first + k, first + following
        faces += [np.stack([a, b, a + SPOKES], axis=1), np.stack([b, b + SPOKES, a + SPOKES], axis=1)]
    points = np.vstack([[[0.0, 0.0, 0.0], [0.0, 8.0, 0.0]], *rings])
    return points, outward(points, np.concatenate(faces), lambda middle: middle - [0.0, 4.0, 0.0])


@pytest.mark.parametrize("strips", [3, 9])
def test_a_flat_face_with_a_fillet_bears_as_a_punch_with_rounded_edges(strips, tmp_path):
    """F = (K/h) ∫ 2πr (d - y(r)) dr, y = 0 on the flat face and the fillet's height beyond."""
    write_obj(tmp_path / "button.obj", *button_mesh(strips))
    write_obj(tmp_path / "plate.obj", *sheet_mesh(36.0, 1.0))
    (tmp_path / "s.toml").write_text(mesh_scene_text("button.obj", "plate.obj"))
    model = cc.ElasticFoundation(cc.load_scene(tmp_path / "s.toml"), (300, 300))
    step = (FLAT + FILLET) / 20000
    radius = step * (np.arange(20000) + 0.5)
    height = FILLET - np.sqrt(np.maximum(FILLET**2 - np.maximum(radius - FLAT, 0.0) ** 2, 0.0))
    for overlap in (0.05, 0.2):
        depth = np.maximum(overlap - height, 0.0)
        wanted = STIFFNESS * step * float((2.0 * np.pi * radius * depth).sum())
        loads = model(np.array([[0.0, -overlap, 0.0, 0.0, 0.0, 0.0]]))[0]
        assert -loads[model.load_names.index("Fy")] == pytest.approx(wanted, rel=0.05)
