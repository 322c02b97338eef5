"""Samples of each model that they may be drawn from: elements, and the foundation."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest

from casadi_contact.contact.cells.basis import Cells
from casadi_contact.contact.cells.foundation import CellFoundation
from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.samples.draw import draw_samples
from casadi_contact.samples.models import MODELS, teacher_of
from casadi_contact.samples.reference import reference_motion
from casadi_contact.samples.samples import read_samples
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.loading import load_scene
from casadi_contact.scenes.walking import reference_motion_cycles


def test_contact_that_ends_within_the_outermost_cell_has_no_load_at_the_edge():
    """A ball 0.1 mm deep in a plane of ±12 mm touches within 2.45 mm: up to 10.95 and 12.95 mm from the middle."""
    cells = CellFoundation(load_scene("sphere_on_plane"), Cells(4.0, 4.0), compiled=False)
    poses = np.array([[x, 29.9, 0.0, 0.0, 0.0, 0.0] for x in (0.0, 8.5, 10.5)])
    assert cells.at_edge(poses)[:, 0].tolist() == [False, True, True]
    assert (cells.edge_share(poses)[:, 0] > 0.01).tolist() == [False, False, True]
    assert (cells.edge_wrenches(poses)[:, 0, 1] < -1.0).tolist() == [False, False, True]


def test_the_hip_on_its_foundation_has_the_element_grid_s_samples_with_less_error(tmp_path):
    """Settled and evaluated on one model, samples have the wanted loads themselves."""
    scene = load_scene("hip")
    settings = SamplingSettings.from_scene(scene, scale=0.002, frames=21)
    made = {}
    for name in ("elements", "foundation"):
        models = MODELS[name]
        motion, report = reference_motion(models(scene, settings)[0], reference_motion_cycles(scene, ())[:2], settings)
        assert report.converged.all()
        with ThreadPoolExecutor(1) as executor:
            path = tmp_path / f"{name}.h5"
            samples = draw_samples(scene, motion, path, settings=settings, executor=executor, models=models)
        made[name] = read_samples(path)
        assert samples.provenance["models"] == name
    elements, smooth = made["elements"], made["foundation"]
    assert abs(len(smooth) - len(elements)) <= 0.02 * len(elements)
    pressed = smooth.select("D7")
    np.testing.assert_allclose(np.linalg.norm(pressed.wrenches[:, 0, :3], axis=1), scene.boundary_load, atol=1e-2)
    teacher = teacher_of(smooth)
    np.testing.assert_allclose(teacher.wrenches(smooth.poses), smooth.wrenches, rtol=1e-9, atol=1e-6)
    assert teacher_of(elements).grid == (160, 160)
    fine = ElasticFoundation(scene, (320, 320))
    off = [np.abs(s.wrenches - fine.wrenches(s.poses))[:, :, :3].max() for s in (smooth, elements)]
    assert off[0] < off[1]


def test_samples_of_a_foundation_serve_their_own_tolerances_alone(tmp_path):
    """A foundation is as fine as the tolerances it was chosen for; a grid of elements does not know them."""
    scene = load_scene("hip")
    counts = {**dict.fromkeys(("D1", "D2", "D3", "D4", "D5", "D6"), 0), "D7": 10}
    settings = SamplingSettings.from_scene(scene, frames=5, counts=counts)
    elements, cycles = ElasticFoundation(scene, settings.settle_grid), reference_motion_cycles(scene, ())[:2]
    motion, _ = reference_motion(elements, cycles, settings)
    finer = scene.with_tolerances(**{name: 0.5 * tolerance for name, tolerance in scene.tolerances.items()})
    with ThreadPoolExecutor(1) as here:
        for name in ("elements", "foundation"):
            again = partial(draw_samples, path=tmp_path / name, settings=settings, executor=here, models=MODELS[name])
            first = again(scene, motion)
            if name == "foundation":
                with pytest.raises(ValueError, match="tolerances"):
                    again(finer, motion)
            else:
                np.testing.assert_array_equal(again(finer, motion).poses, first.poses)
