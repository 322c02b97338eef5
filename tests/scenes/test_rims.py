"""Contact ends at the rim of a closed part, whatever its grid, and goes on where a patch ends before the part."""

import numpy as np
import pytest

from tests.support.meshes import ball_mesh, outward, scene_of, slab_mesh

GRIDS = [(40, 20), (60, 60), (160, 80)]
HALF_MM = np.array([13.0, 17.0])


def oval_dish(edge_mm, hollow_mm):
    """A closed dish, hollow by the sphere's radius, whose outline is an ellipse; its rim falls steeply."""
    rings, around = int(HALF_MM.max() / edge_mm), int(2.0 * np.pi * HALF_MM.max() / edge_mm)
    share, angle = np.arange(1, rings + 1) / rings, 2.0 * np.pi * np.arange(around) / around
    x, z = (half * np.outer(share, of(angle)).ravel() for half, of in zip(HALF_MM, (np.cos, np.sin), strict=True))
    x, z = np.append(0.0, x), np.append(0.0, z)
    y = hollow_mm - np.sqrt(hollow_mm**2 - x**2 - z**2)
    return slab_mesh(*ringed(np.stack([x, y, z], axis=1), around), 6.0)


def ringed(points, around):
    """Points, the middle first and then rings of so many, and the triangles between them, facing +y."""
    j, k = np.arange(around), (np.arange(around) + 1) % around
    faces = [np.stack([0 * j, 1 + k, 1 + j], axis=1)]
    for first in range(1, len(points) - around, around):
        a, b, c, d = first + j, first + k, first + around + j, first + around + k
        faces += [np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)]
    return points, outward(points, np.concatenate(faces), lambda p: 0.0 * p + [0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def dish(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dish")
    return lambda extra="": scene_of(folder, ball_mesh(24.0, 1.5), oval_dish(0.8, 27.0), extra=extra)


@pytest.mark.parametrize("grid", GRIDS)
def test_elements_are_cut_where_a_patch_ends_before_the_part_and_not_at_its_rim(dish, grid):
    (patch,) = dish().elements(grid)
    assert len(patch.edge_centres_mm) == 0
    low = "[geometry.patches.contact]\nx = [-100.0, 5.0]\n"
    (patch,) = dish(low).elements(grid)
    assert len(patch.edge_centres_mm) >= grid[1] // 2
    assert np.all(patch.edge_centres_mm[:, 0] > 5.0 - 1.5 * 18.0 / grid[0])


def socket(radius_mm, angle, edge_mm, outer_mm):
    """A closed block with a spherical hollow as deep as an angle from its pole, flat around it."""
    down = angle * np.arange(1, int(radius_mm * angle / edge_mm) + 1) / int(radius_mm * angle / edge_mm)
    brim = radius_mm * np.sin(angle)
    flat = np.linspace(brim, outer_mm, int((outer_mm - brim) / edge_mm) + 1)[1:]
    radii = np.append(radius_mm * np.sin(down), flat)
    heights = np.append(radius_mm * (np.cos(angle) - np.cos(down)), 0.0 * flat)
    around = int(2.0 * np.pi * outer_mm / edge_mm)
    turn = 2.0 * np.pi * np.arange(around) / around
    sides = [np.outer(radii, np.cos(turn)), np.outer(heights, np.ones(around)), np.outer(radii, np.sin(turn))]
    points = np.vstack([[0.0, radius_mm * (np.cos(angle) - 1.0), 0.0], np.stack(sides, axis=-1).reshape(-1, 3)])
    return slab_mesh(*ringed(points, around), radius_mm + 5.0)


def test_elements_are_cut_where_a_socket_grows_too_steep_for_them(tmp_path):
    """Its wall goes on and faces the ball: a load to the side is carried there, by no element of this grid."""
    grid = (60, 60)
    scene = scene_of(tmp_path, ball_mesh(14.5, 1.2), socket(15.0, np.radians(85.0), 1.0, 20.0))
    (patch,) = scene.elements(grid)
    assert len(patch.edge_centres_mm) > grid[0] // 2
    radii = np.hypot(patch.edge_centres_mm[:, 0], patch.edge_centres_mm[:, 2])
    assert np.median(radii) > 12.0
