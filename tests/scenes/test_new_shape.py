"""A new shape is one class and one registration: loaded, checked and evaluated like those that are there."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.geometry.elements import cell_middles
from casadi_contact.geometry.moving_surface import sphere
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.shapes.shape import SHAPES, Parameter, Shape, register

RADIUS_MM, CYLINDER_MM, STIFFNESS = 30.0, 40.0, 267.5728  # mm, mm, K/h of the ready scenes' material [N/mm³]


class SphereOnCylinder(Shape):
    """A sphere on an elastic cylinder about the fixed z axis, over a strip of its top."""

    name = "sphere_on_cylinder"
    parameters = (
        Parameter("radius", "mm"),
        Parameter("cylinder_radius", "mm"),
        Parameter("half_angle_deg", "deg", high=89.0),
        Parameter("length", "mm"),
    )

    def surfaces(self, geometry):
        return [sphere(geometry["radius"])]

    def cells(self, geometry, grid):
        (nx, nz), R, length = grid, geometry["cylinder_radius"], geometry["length"]
        half = np.deg2rad(geometry["half_angle_deg"])
        angle, z = np.meshgrid(half * cell_middles(nx), 0.5 * length * cell_middles(nz), indexing="ij")
        normals = np.stack([np.sin(angle), np.cos(angle), np.zeros_like(angle)], axis=-1)
        centres = R * normals + np.stack([np.zeros_like(z), np.zeros_like(z), z], axis=-1)
        return [(centres, normals, np.full(grid, R * 2.0 * half / nx * length / nz))]


@pytest.fixture(autouse=True)
def registered():
    register(SphereOnCylinder())
    yield
    del SHAPES["sphere_on_cylinder"]


def scene_file(folder, **geometry):
    numbers = {"radius": RADIUS_MM, "cylinder_radius": CYLINDER_MM, "half_angle_deg": 8.0, "length": 12.0} | geometry
    tables = {**cc.load_scene("sphere_on_plane").tables, "name": "mine", "shape": "sphere_on_cylinder"}
    tables["geometry"] = numbers
    path = folder / "mine.toml"
    path.write_text(Scene.from_tables(tables).to_toml())
    return path


def force(overlap):
    """K/h·∫ depth·cos θ dA, the force along y, as a sum over small cells of the cylinder.

    The ray from the axis at the angle θ and the height z enters the sphere, whose centre lies D = R + r - d from the
    axis, at D cos θ - √(r² - z² - D² sin² θ): the depth is how far this lies below the surface at R.
    """
    D = CYLINDER_MM + RADIUS_MM - overlap
    angle, z = np.meshgrid(np.linspace(-0.13, 0.13, 4001), np.linspace(-6.0, 6.0, 2001), indexing="ij")
    depth = CYLINDER_MM - (D * np.cos(angle) - np.sqrt(RADIUS_MM**2 - z**2 - (D * np.sin(angle)) ** 2))
    cell = CYLINDER_MM * (angle[1, 0] - angle[0, 0]) * (z[0, 1] - z[0, 0])
    return STIFFNESS * (np.maximum(depth, 0.0) * np.cos(angle)).sum() * cell


def test_its_force_is_that_of_the_integral(tmp_path):
    model = cc.ElasticFoundation(cc.load_scene(scene_file(tmp_path)), (400, 300))
    loads = dict(zip(model.load_names, model([0.0, CYLINDER_MM + RADIUS_MM - 0.1, 0.0, 0.0, 0.0, 0.0]), strict=True))
    assert -loads["Fy"] == pytest.approx(force(0.1), rel=1e-4)
    assert abs(loads["Fx"]) + abs(loads["Fz"]) < 1e-6


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({}, "registered"),
        ({"half_angle_deg": 95.0}, "geometry.half_angle_deg = 95.0, expected a number between 0 and 89"),
        ({"radius": -1.0}, "geometry.radius = -1.0"),
        ({"colour": 1.0}, "unknown key geometry.colour"),
    ],
)
def test_its_numbers_are_checked_by_name_and_its_own_name_is_taken_once(tmp_path, wrong, said):
    scene = cc.load_scene(scene_file(tmp_path))
    assert Scene.from_toml(scene.to_toml()) == scene
    with pytest.raises(ValueError, match=said):
        scene_file(tmp_path, **wrong) if wrong else register(SphereOnCylinder())
