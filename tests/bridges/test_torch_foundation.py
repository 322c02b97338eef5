"""The elastic foundation on a torch device has the numbers of the elastic foundation, and draws the same samples.

Tensors of the processor stand for a device in every test; where there is a GPU, it is tested as well.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="a foundation on a device needs the extra train")

from casadi_contact import pipeline  # noqa: E402
from casadi_contact.bridges import torch_surfaces  # noqa: E402
from casadi_contact.bridges.torch_foundation import FoundationsOn, TorchFoundation  # noqa: E402
from casadi_contact.contact import ElasticFoundation  # noqa: E402
from casadi_contact.dataset import write_samples  # noqa: E402
from casadi_contact.project import Project, reference_motion_cycles  # noqa: E402
from casadi_contact.project.presets import Effort, Preset  # noqa: E402
from casadi_contact.sampling import SamplingSettings, draw_samples, foundations, reference_motion, teacher_of  # noqa: E402
from casadi_contact.sampling.draw import elastic_foundations  # noqa: E402
from casadi_contact.scenes import load_scene  # noqa: E402
from casadi_contact.show import contact_pose  # noqa: E402
from casadi_contact.structures import load_surrogate  # noqa: E402
from tests.support.smooth_samples import smooth_samples  # noqa: E402

DEVICES = ["cpu", pytest.param("cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU here"))]
USUAL_N = 1000.0
GRID = (28, 18)
SCENES = ("knee", "cylinder_on_plane", "punch_on_plane", "sphere_in_dish", "patellofemoral", "glenohumeral")


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    """Threads of torch wait for each other on a busy machine."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(params=DEVICES)
def device(request):
    return request.param


def poses_of(scene, count=40):
    """Some in contact, some apart: around 0.1 mm of overlap."""
    middle = np.array(contact_pose(ElasticFoundation(scene, GRID)))
    return middle + np.random.default_rng(0).normal(size=(count, 6)) * [0.3, 0.3, 0.3, 0.003, 0.02, 0.02]


def close(got, wanted):
    """To 1e-9 of a usual load, or of what is larger."""
    np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-9 * USUAL_N)


@pytest.mark.parametrize("name", SCENES)
def test_loads_slopes_gaps_and_edges_are_those_of_the_elastic_foundation(name, device):
    scene = load_scene(name)
    here, there = ElasticFoundation(scene, GRID), TorchFoundation(scene, GRID, device=device, poses_at_once=17)
    poses = poses_of(scene)
    touching = (here.wrenches(poses) != 0.0).any(axis=(1, 2))
    assert touching.any()
    assert not touching.all()
    close(there.wrenches(poses), here.wrenches(poses))
    close(there.part_wrenches(poses), here.part_wrenches(poses))
    for got, wanted in zip(there.jacobian(poses), here.jacobian(poses), strict=True):
        close(got, wanted)
    for got, wanted in zip(there.root_loads(poses), here.root_loads(poses), strict=True):
        close(got, wanted)
    close(there.gaps(poses), here.gaps(poses))
    np.testing.assert_array_equal(there.at_edge(poses), here.at_edge(poses))


def test_the_logarithmic_law_goes_on_along_its_tangent(device):
    """At overlaps of up to the layer's thickness, where the law would be infinite."""
    scene = load_scene("sphere_on_plane", law="log")
    poses = np.zeros((30, 6))
    poses[:, 1] = scene.start_pose[1] - np.linspace(-0.5, 8.5, 30)
    close(TorchFoundation(scene, GRID, device=device)(poses), ElasticFoundation(scene, GRID)(poses))


def test_chunks_of_any_size_and_no_poses_at_all_give_the_same(device):
    scene = load_scene("knee")
    poses = poses_of(scene, 11)
    whole = TorchFoundation(scene, GRID, device=device)
    np.testing.assert_array_equal(whole(poses), TorchFoundation(scene, GRID, device=device, poses_at_once=1)(poses))
    assert whole(poses[:0]).shape == (0, 7)
    assert whole(poses[0]).shape == (7,)
    for wrong in (0, -1, 1.5):
        with pytest.raises(ValueError, match=r"poses_at_once is .*, expected a whole number of 1 or more"):
            TorchFoundation(scene, GRID, device=device, poses_at_once=wrong)


def test_samples_are_drawn_as_on_the_processor(device, tmp_path):
    """Settled and evaluated on the device: the same poses are kept, equal to what settling leaves open."""
    scene = load_scene("knee")
    settings = SamplingSettings(
        counts={"D1": 12, "D4": 4, "D5": 4}, frames=5, settle_grid=(28, 18), teacher_grid=(40, 30), most_dropped=1.0
    )
    motion, _ = reference_motion(ElasticFoundation(scene, (28, 18)), reference_motion_cycles(scene, ()), settings)
    drawn = []
    for name, models in (("here", elastic_foundations), ("there", FoundationsOn(device))):
        with ThreadPoolExecutor(1) as executor:
            path = tmp_path / f"{name}.h5"
            drawn.append(draw_samples(scene, motion, path, settings=settings, executor=executor, models=models))
    here, there = drawn
    assert len(here) == len(there) > 15
    np.testing.assert_allclose(there.poses, here.poses, atol=1e-6)
    np.testing.assert_allclose(there.wrenches, here.wrenches, rtol=1e-6, atol=0.01)
    np.testing.assert_allclose(there.gaps, here.gaps, atol=1e-6)
    assert there.provenance["models"] == here.provenance["models"]
    assert type(teacher_of(there)) is ElasticFoundation, "calibration finds the model again, without a device"


def test_a_surrogate_is_trained_on_a_device_and_says_so(device, tmp_path):
    on = "cpu:0" if device == "cpu" else device
    efforts = {"patch": {"root": Effort(((6, 6),), 1.0), "ratio": Effort(((4,),), 0.1)}}
    project = replace(Project.open("sphere_on_plane", "quick", tmp_path), own=Preset(1.0, efforts))
    samples = replace(smooth_samples(300), provenance={"table": "none"})
    write_samples(project.samples_path, samples)
    (path,) = pipeline.train(project, device=on)
    surrogate = load_surrogate(path)
    assert surrogate.info().record["machine"]["device"].startswith(on)
    off = surrogate(samples.poses)[:, 1] - samples.wrenches[:, 0, 1]
    assert np.sqrt(np.mean(off**2)) < 20.0  # N, of 1,000


def test_the_foundation_of_no_training_is_not_drawn_from_on_a_device(tmp_path):
    with pytest.raises(ValueError, match="device 'cpu:0' with another contact model, expected the elements'"):
        pipeline.sample(Project.open("knee", "quick", tmp_path), models=foundations, device="cpu:0")


def test_what_a_device_does_not_know_is_refused_in_one_line(monkeypatch):
    with pytest.raises(ValueError, match="device 'magic' cannot be used"):
        TorchFoundation(load_scene("knee"), GRID, device="magic")
    monkeypatch.delitem(torch_surfaces.LAWS, "log")
    with pytest.raises(ValueError, match="pressure law 'log' on device 'cpu', expected one of linear"):
        TorchFoundation(load_scene("knee", law="log"), GRID, device="cpu")
