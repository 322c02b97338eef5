"""What of a plan is refused before it is drawn."""

from dataclasses import replace

import pytest

from casadi_contact.samples.chunk import plan_chunks
from casadi_contact.samples.reference import reference_motion
from casadi_contact.samples.settings import SamplingSettings
from tests.support import two_spheres
from tests.support.two_spheres import TwoSpheres, knee

SETTINGS = SamplingSettings(scale=0.003, frames=21)
MODEL = TwoSpheres(knee())
MOTION = reference_motion(MODEL, two_spheres.cycles(MODEL)[0], SETTINGS)[0]


def test_a_plan_that_cannot_lift_one_patch_is_refused_before_any_of_it_is_drawn():
    """As of a knee with a patch on its post: the refusal came with the first lifted patch, minutes into the drawing."""
    scene = knee()
    assert 4 in {chunk.domain for chunk in plan_chunks(scene, MOTION, SETTINGS)}
    three = replace(scene, sensitive_pose=("ty", "rx", "tx"))
    with pytest.raises(ValueError, match=r"expected these, or sampling\.counts\.D4 = 0"):
        plan_chunks(three, MOTION, SETTINGS)
    assert plan_chunks(three, MOTION, replace(SETTINGS, counts={**SETTINGS.counts, "D4": 0}))
