"""Two soft bodies as springs in series, and layers whose thickness varies: closed forms, in every form of a model."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.finite_elements.model import FiniteElements
from casadi_contact.scenes.scene import Scene
from tests.support.compiler import needs_compiler
from tests.support.ready_poses import at

MODELS = {
    "elements": lambda scene: cc.ElasticFoundation(scene, (60, 60)),
    "cells": lambda scene: cc.CellFoundation(scene, Cells(1.0, 1.0)),
    "cells in NumPy": lambda scene: cc.CellFoundation(scene, Cells(1.0, 1.0), compiled=False),
    "rays": lambda scene: cc.PolarFoundation(scene, cc.Rays(16, 4)),
}
SOFT = {"youngs_modulus": 10.0, "poissons_ratio": 0.3, "thickness": 5.0}


def scene_of(name, **material):
    tables = cc.load_scene(name).tables
    return Scene.from_tables({**tables, "material": {**tables["material"], **material}})


def wedge(slope=0.4, **material):
    """The layer of a punch of 10 mm × 10 mm: 8 mm thick in the middle, thicker to the front."""
    rows = [[8.0 - 5.0 * slope], [8.0 + 5.0 * slope]]
    return scene_of("punch_on_plane", thickness_map={"x": [-5.0, 5.0], "z": [0.0], "mm": rows}, **material)


@needs_compiler
@pytest.mark.parametrize("law", ["linear", "log"])
@pytest.mark.parametrize("form", ["elements", "cells in NumPy", "rays"])
def test_two_layers_of_one_material_are_one_as_thick_as_both(form, law):
    own = {"youngs_modulus": 463.0, "poissons_ratio": 0.46, "thickness": 3.0}
    scenes = (
        scene_of("sphere_on_plane", law=law),
        scene_of("sphere_on_plane", **own, moving=own | {"thickness": 5.0}, law=law),
    )
    one, two = (MODELS[form](scene)(at(29.8)) for scene in scenes)
    np.testing.assert_allclose(two, one, rtol=1e-12, atol=1e-9)


def test_layers_in_series_divide_the_depth_so_that_pressures_are_equal():
    scene = scene_of("punch_on_plane", moving=SOFT)
    K1, K2 = scene.material.modulus, scene.material.moving.modulus
    force = -MODELS["elements"](scene)(at(-0.2))[0, 1]
    assert force == pytest.approx(100.0 * 0.2 / (8.0 / K1 + 5.0 / K2))


@pytest.mark.parametrize("name", ["youngs_modulus", "thickness"])
def test_parameters_are_those_of_the_fixed_layer_alone(name):
    value = 1.5 * getattr(cc.load_scene("punch_on_plane").material, name)
    found = MODELS["cells in NumPy"](scene_of("punch_on_plane", moving=SOFT)).function(parameters=name)(
        at(-0.2)[0], value
    )
    expected = MODELS["cells in NumPy"](scene_of("punch_on_plane", moving=SOFT, **{name: value}))(at(-0.2)[0])
    np.testing.assert_allclose(np.ravel(found), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("moving", [None, SOFT], ids=["one layer", "two"])
@pytest.mark.parametrize("form", [name for name in MODELS if name != "rays"])
def test_a_wedge_under_a_flat_punch_carries_the_integral_of_one_over_its_thickness(form, moving):
    """F = K·d·∫ dA/h and T_z = ∫ x dF over h = 8 + s·x: logarithms of the ends' thicknesses."""
    s, d, side = 0.4, 0.2, 10.0
    scene = wedge(s, **({"moving": moving} if moving else {}))
    K, h = scene.material.modulus, 8.0 + scene.material.in_series
    whole = np.log((h + 0.5 * s * side) / (h - 0.5 * s * side)) / s  # ∫ dx/h
    loads = dict(zip(scene.load_names, MODELS[form](scene)(at(-d))[0], strict=True))
    force = K * d * side * whole
    assert -loads["Fy"] == pytest.approx(force, rel=5e-4)
    assert -loads["Tz"] == pytest.approx(K * d * side * (side - h * whole) / s, abs=1e-3 * side * force)


def test_thickness_is_that_of_the_backing_mesh_along_the_normal(tmp_path):
    meshes = pytest.importorskip("tests.support.meshes")
    meshes.write_obj(tmp_path / "bone.obj", *meshes.sheet_mesh(16.0, 2.0, lambda x, z: -6.0 - 0.1 * x))
    ball, floor = meshes.cap_mesh(30.0, 1.2, 0.25), meshes.sheet_mesh(9.0, 1.5)
    scene = meshes.scene_of(tmp_path, ball, floor, extra='backing = "bone.obj"')
    points, up = np.array([[x, 0.0, 1.0] for x in (-4.0, 0.0, 3.0)]), np.tile([0.0, 1.0, 0.0], (3, 1))
    np.testing.assert_allclose(scene.thickness_at(points, up), 6.0 + 0.1 * points[:, 0], rtol=2e-3)
    pose = at(29.9, tx=1.5)
    cells = cc.CellFoundation(scene, Cells(0.8, 0.8), compiled=False)
    for model in (cc.ElasticFoundation(scene), cells):
        assert model(pose)[0, 1] == pytest.approx(-np.pi * scene.material.modulus / 6.15 * 0.1**2 * 30.0, rel=0.02)
    (tmp_path / "bone.obj").unlink()
    with pytest.raises(FileNotFoundError):
        cc.load_scene(tmp_path / "scene.toml")


@pytest.mark.parametrize(
    ("refused", "said"),
    [
        (lambda: cc.CellFoundation(wedge(law="log")), "law"),
        (lambda: cc.foundation(wedge(law="log")), "law"),
        (lambda: FiniteElements(wedge()), "one layer"),
        (lambda: FiniteElements(scene_of("punch_on_plane", moving=SOFT)), "one layer"),
        (lambda: cc.CellFoundation(wedge()).pressures(at(-0.2)), "pressures"),
        (lambda: cc.CellFoundation(wedge(moving=SOFT)).function(parameters="thickness"), "series"),
        (lambda: wedge(2.0), "thickness_map"),
        (
            lambda: scene_of("punch_on_plane", thickness_map={"x": [1.0, 0.0], "z": [0.0], "mm": [[1.0], [1.0]]}),
            "rising",
        ),
        (lambda: scene_of("punch_on_plane", moving=SOFT | {"law": "log"}), "material.moving.law"),
        (lambda: scene_of("punch_on_plane", moving=SOFT | {"thickness": 0.0}), "material.moving.thickness"),
    ],
)
def test_what_has_no_such_layers_says_so(refused, said):
    with pytest.raises(ValueError, match=said):
        refused()


def test_polar_foundations_take_one_thickness():
    tables = scene_of("sphere_in_dish", thickness_map={"x": [0.0], "z": [0.0], "mm": [[8.0]]})
    with pytest.raises(ValueError, match="ElasticFoundation"):
        cc.PolarFoundation(tables)
