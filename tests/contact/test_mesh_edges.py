"""Contact at rims, creases, fillets and sharp edges of meshes: what lies on the surface bears."""

import numpy as np
import pytest

import casadi_contact as cc
from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.elements.foundation import share_at_sharp_edges
from casadi_contact.geometry.triangle_mesh import TriangleMesh, smooth_regions
from casadi_contact.optimisation.reference import unmodelled_load_words
from tests.support.meshes import STIFFNESS, ball_mesh, cap_mesh, outward, scene_of, sheet_mesh, slab_mesh, wheel_mesh

RADIUS_MM, SIDE_MM, TURN = 12.0, 12.0, 0.4  # of the ball, of a square sheet, and its turn about y
OVERLAP_MM = 0.2


@pytest.fixture(scope="module", params=["sheet", "slab"])
def oblique(request, tmp_path_factory):
    """A ball above a square sheet, or the top of a slab with sharp edges, askew to the lines between cells."""
    vertices, faces = sheet_mesh(SIDE_MM, 1.0)
    turned = turned_about_y(vertices)
    fixed = (turned, faces) if request.param == "sheet" else slab_mesh(turned, faces, 6.0)
    return scene_of(tmp_path_factory.mktemp("rim"), cap_mesh(RADIUS_MM, 0.8, 0.9), fixed, grid=(160, 160))


def turned_about_y(points):
    x, y, z = points.T
    return np.column_stack([x * np.cos(TURN) - z * np.sin(TURN), y, x * np.sin(TURN) + z * np.cos(TURN)])


def exact_force(pose):
    """K/h·∫ depth dx dz of the part of the ball above the sheet, by midpoints."""
    reach = np.linspace(-3.0, 3.0, 1201)
    x, z = np.meshgrid(pose[0] + reach, pose[2] + reach, indexing="ij")
    u, w = x * np.cos(TURN) + z * np.sin(TURN), z * np.cos(TURN) - x * np.sin(TURN)
    on = (np.abs(u) < 0.5 * SIDE_MM) & (np.abs(w) < 0.5 * SIDE_MM)
    away = (x - pose[0]) ** 2 + (z - pose[2]) ** 2
    depth = np.sqrt(RADIUS_MM**2 - away) - pose[1]
    return STIFFNESS * (np.maximum(depth, 0.0) * on).sum() * (reach[1] - reach[0]) ** 2


@pytest.mark.parametrize("cells", [Cells(1.2, 0.85), Cells(2.0, 1.7, 6, 6)], ids=str)
def test_a_ball_over_an_oblique_rim_presses_with_what_lies_on_it(oblique, cells):
    """Cells that count sub-points all or nothing are off by 4 to 6 %, at a rounded edge by 19 %."""
    random, along = np.random.default_rng(2), np.linspace(-4.0, 4.0, 24)
    beside = 0.5 * SIDE_MM + random.uniform(-1.0, 0.5, 24)
    poses = np.zeros((24, 6))
    poses[:, 0] = beside * np.cos(TURN) - along * np.sin(TURN)
    poses[:, 2] = beside * np.sin(TURN) + along * np.cos(TURN)
    poses[:, 1] = RADIUS_MM - random.uniform(0.1, 0.3, 24)
    model = cc.CellFoundation(oblique, cells, compiled=False)
    found, exact = -model.wrenches(poses)[:, 0, 1], np.array([exact_force(pose) for pose in poses])
    assert model.at_edge(poses).all()
    off = found / exact - 1.0
    assert np.abs(off).max() < 0.02


def test_a_step_ends_at_its_edge_for_elements_and_cells(tmp_path):
    """A floor 3 mm below, seen beside the edge, makes it no less of a rim."""
    vertices, faces = sheet_mesh(SIDE_MM + 4.0, 1.0)
    flat = vertices[:, [0, 2]]
    vertices[np.abs(flat).max(axis=1) > 0.5 * SIDE_MM, 1] = -3.0
    foot = np.isclose(np.abs(flat), 0.5 * SIDE_MM + 1.0)
    vertices[:, [0, 2]] = np.where(foot, np.sign(flat) * (0.5 * SIDE_MM + 0.02), flat)
    scene = scene_of(tmp_path, cap_mesh(RADIUS_MM, 0.8, 0.9), (turned_about_y(vertices), faces), grid=(320, 320))
    middles = [[0.5 * SIDE_MM + b, RADIUS_MM - 0.2, a] for b in (-1.1, 0.0, 0.5, 1.1) for a in (-2.0, 0.3)]
    poses = np.column_stack([turned_about_y(np.array(middles)), np.zeros((8, 3))])
    exact = np.array([exact_force(pose) for pose in poses])
    for model in (cc.ElasticFoundation(scene), cc.CellFoundation(scene, Cells(1.2, 0.85), compiled=False)):
        force = -model.wrenches(poses)[:, 0, :3]
        assert np.linalg.norm(force - exact[:, None] * [0.0, 1.0, 0.0], axis=1).max() < 0.03 * exact.max()


EDGE_MM, OUTER_MM = 6.0, 8.0  # half the width of the slab's top, and of all of it
ALONG = np.array([[np.cos(TURN), 0.0, np.sin(TURN)], [0.0, 1.0, 0.0], [-np.sin(TURN), 0.0, np.cos(TURN)]])


def chamfered_slab(slope):
    """A slab whose top falls off beyond two straight edges."""
    vertices, faces = sheet_mesh(2.0 * OUTER_MM, 1.0, lambda u, w: -slope * np.maximum(np.abs(u) - EDGE_MM, 0.0))
    return slab_mesh(vertices @ ALONG, faces, 8.0)


def side_force(centre, start, tangent, low, high):
    """Force (2,) of the ball about `centre` (2,) on the strip start + s·tangent, low < s < high, across the edge:
    K/h·∫ depth dA against its normal, depth along that, by midpoints."""
    step = 0.004
    reach = np.arange(-3.0, 3.0, step) + 0.5 * step
    s, w = np.meshgrid(reach[(reach > low) & (reach < high)], reach, indexing="ij")
    normal = np.array([-tangent[1], tangent[0]])
    away, height = (centre - start) @ tangent, (centre - start) @ normal
    inside = RADIUS_MM**2 - (s - away) ** 2 - w**2
    depth = np.sqrt(np.maximum(inside, 0.0)) - height
    return -STIFFNESS * step**2 * np.maximum(depth, 0.0)[inside > 0.0].sum() * normal


@pytest.mark.parametrize("slope", [1.0, np.sqrt(3.0)], ids=["45 degrees", "60 degrees"])
def test_both_sides_of_a_chamfers_edge_bear(tmp_path, slope):
    """The surface goes on beyond the edge, which is no rim; a distance field would round it off."""
    scene = scene_of(tmp_path, cap_mesh(RADIUS_MM, 0.8, 1.2), chamfered_slab(slope), grid=(320, 320))
    edge, fall = np.array([EDGE_MM, 0.0]), np.array([1.0, -slope]) / np.hypot(1.0, slope)
    poses, exact = np.zeros((4, 6)), np.zeros((4, 3))
    for k, beside in enumerate((-1.1, -0.4, 0.0, 0.8)):
        height = RADIUS_MM - OVERLAP_MM if beside <= 0.0 else np.sqrt((RADIUS_MM - OVERLAP_MM) ** 2 - beside**2)
        centre = edge + np.array([beside, height])
        force = side_force(centre, edge, np.array([1.0, 0.0]), -3.0, 0.0) + side_force(centre, edge, fall, 0.0, 3.0)
        poses[k, :3], exact[k] = np.array([[*centre, 0.3], [*force, 0.0]]) @ ALONG
    size = np.linalg.norm(exact, axis=1)
    elements, cells = cc.ElasticFoundation(scene), cc.CellFoundation(scene, Cells(1.2, 0.85), compiled=False)
    for model, share in ((elements, 0.015), (cells, 0.06)):
        off = np.linalg.norm(model.wrenches(poses)[:, 0, :3] - exact, axis=1) / size
        assert off.max() < share
        assert not model.at_edge(poses).any()


@pytest.mark.parametrize(("first", "regions"), [(1.3, 2), (0.0, 1)])
def test_a_crease_parts_a_surface_where_it_ends_nowhere(first, regions):
    """A sheet folded along x = 0 by a slope of 1.3, or by one that grows from nothing to that along the fold."""
    vertices, faces = sheet_mesh(
        16.0, 1.0, lambda x, z: -np.maximum(x, 0.0) * (first + (1.3 - first) * (z + 8.0) / 16.0)
    )
    assert len(np.unique(smooth_regions(TriangleMesh("sheet", vertices, faces)))) == regions


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
    model = cc.ElasticFoundation(scene_of(tmp_path, button_mesh(strips), sheet_mesh(36.0, 1.0), grid=(300, 300)))
    step = (FLAT + FILLET) / 20000
    radius = step * (np.arange(20000) + 0.5)
    height = FILLET - np.sqrt(np.maximum(FILLET**2 - np.maximum(radius - FLAT, 0.0) ** 2, 0.0))
    for overlap in (0.05, 0.2):
        depth = np.maximum(overlap - height, 0.0)
        wanted = STIFFNESS * step * float((2.0 * np.pi * radius * depth).sum())
        loads = model(np.array([[0.0, -overlap, 0.0, 0.0, 0.0, 0.0]]))[0]
        assert -loads[model.load_names.index("Fy")] == pytest.approx(wanted, rel=0.05)


HALF_WIDTH = 3.0  # of the wheel


def model_of(folder, moving, spacing_mm):
    extra = f"spacing = {{moving = {spacing_mm}, fixed = 0.75}}"
    return cc.ElasticFoundation(scene_of(folder, moving, sheet_mesh(16.0, 1.0), extra=extra, grid=(200, 200)))


def leaning(tilt, overlap):
    """The pose of a wheel that leans on its edge, and what the plate carries: (K/h) ∫ depth, over a grid of its own."""
    pose = np.array([0.0, RADIUS_MM * np.cos(tilt) + HALF_WIDTH * np.sin(tilt) - overlap, 0.0, tilt, 0.0, 0.0])
    step = 0.01
    x, z = np.meshgrid(np.arange(-5.0, 5.0, step), np.arange(-8.0, 8.0, step), indexing="ij")
    along, up = z * np.cos(tilt) - pose[1] * np.sin(tilt), -z * np.sin(tilt) - pose[1] * np.cos(tilt)
    tread = up + np.sqrt(RADIUS_MM**2 - x**2)  # above the lowest point of the tread, square to the axis
    depth = np.minimum(tread / np.cos(tilt), (HALF_WIDTH + np.sign(tilt) * along) / np.sin(abs(tilt)))
    return pose, STIFFNESS * step**2 * float(np.maximum(depth, 0.0).sum())


def test_where_an_edge_alone_bears_the_error_is_within_the_share_that_is_told_and_a_finer_field_mends_it(tmp_path):
    cases = [leaning(tilt, overlap) for tilt, overlap in ((0.5, 0.25), (0.5, 0.4), (0.2, 0.8))]
    poses, wanted = zip(*cases, strict=True)
    errors, shares = [], []
    for spacing_mm in (1.0, 0.5):
        model = model_of(tmp_path, wheel_mesh(RADIUS_MM, HALF_WIDTH, 0.6), spacing_mm)
        errors.append(np.abs(-model(poses)[:, model.load_names.index("Fy")] / wanted - 1.0))
        shares.append(share_at_sharp_edges(model, poses))
    assert (errors[0] < shares[0] + 0.02).all()
    assert errors[0][:2].min() > 0.05
    assert (errors[1] < 0.3 * errors[0] + 0.01).all()
    assert "in 3 of 3 frames up to 100%" in unmodelled_load_words({"at_sharp_edges": shares[0]})["at_sharp_edges"]
    ball = model_of(tmp_path, ball_mesh(RADIUS_MM, 0.8), 0.75)
    np.testing.assert_array_equal(share_at_sharp_edges(ball, [[0.0, RADIUS_MM - 0.2, 0.0, 0.3, 0.2, 0.1]]), 0.0)
