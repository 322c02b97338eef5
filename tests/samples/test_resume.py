from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.samples.draw import draw_samples
from casadi_contact.samples.reference import ReferenceMotion
from casadi_contact.samples.samples import partial_folder, read_samples
from tests.support import two_spheres
from tests.support.two_spheres import SETTINGS, draw, knee, sphere_motion


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The file of an uninterrupted draw."""
    path = tmp_path_factory.mktemp("whole") / "samples.h5"
    draw(path)
    return path.read_bytes()


def resume(path, **options):
    """Finish the draw; returns how many chunks were there at the start, and how many there are."""
    seen = []
    draw(path, progress=lambda done, total: seen.append((done, total)), **options)
    return seen[0]


def chunks(path):
    return sorted(partial_folder(path).glob("chunk-*.npz"))


@pytest.fixture
def stopped(tmp_path):
    """A draw that ended with an error after three chunks."""

    def stop(done, total):
        if done == 3:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        draw(tmp_path / "samples.h5", progress=stop)
    assert len(chunks(tmp_path / "samples.h5")) == 3
    return tmp_path / "samples.h5"


def test_half_written_files_do_no_harm_and_a_damaged_record_is_refused(stopped, whole):
    """What a power cut may leave: a truncated chunk and a file not renamed yet."""
    first = chunks(stopped)[0]
    first.write_bytes(first.read_bytes()[:100])
    (first.parent / "chunk-000009.npz.77.tmp").write_bytes(b"half")
    with pytest.raises(FileNotFoundError, match="not complete"):
        read_samples(stopped)
    record = first.parent / "plan.json"
    plan = record.read_text("utf-8")
    record.write_text("{")
    with pytest.raises(ValueError, match=r"plan\.json is damaged: delete"):
        resume(stopped)
    record.write_text(plan)
    assert resume(stopped)[0] == 2
    assert stopped.read_bytes() == whole
    assert [path.name for path in stopped.parent.iterdir()] == ["samples.h5"]


def begun_with_other_things():
    moved = ReferenceMotion(sphere_motion().point, sphere_motion().curves, sphere_motion().poses + 1e-9)
    return {
        "seed = 5, now 6": {"settings": replace(SETTINGS, seed=6)},
        "liftoff_mm = 2.0, now 1.0": {"settings": replace(SETTINGS, liftoff_mm=1.0)},
        "another scene": {"scene": knee().with_overrides(frontal_radius=23.0)},
        "another reference motion": {"motion": moved},
        "models = tests.support.two_spheres.models": {"models": lambda *given: two_spheres.models(*given)},
    }


@pytest.mark.parametrize("message", begun_with_other_things())
def test_samples_of_something_else_are_not_continued(message, stopped, tmp_path, whole):
    complete = tmp_path / "complete.h5"
    complete.write_bytes(whole)
    asked = {"scene": knee(), "motion": sphere_motion(), "settings": SETTINGS, "models": two_spheres.models}
    asked |= begun_with_other_things()[message]
    scene, motion = asked.pop("scene"), asked.pop("motion")
    for path in (stopped, complete):
        before = sorted(p.name for p in tmp_path.rglob("*"))
        with pytest.raises(ValueError, match=message) as error, ThreadPoolExecutor(1) as executor:
            draw_samples(scene, motion, path, executor=executor, **asked)
        assert "\n" not in str(error.value)
        assert sorted(p.name for p in tmp_path.rglob("*")) == before


def test_a_kill_between_the_last_rename_and_the_clearing_up(stopped, whole):
    folder = partial_folder(stopped)
    stopped.write_bytes(whole)
    samples = draw(stopped, progress=lambda done, total: pytest.fail("drew again"))
    assert not folder.exists()
    np.testing.assert_array_equal(samples.poses, read_samples(stopped).poses)
