"""Samples of two spheres, drawn around a motion in moments."""

from functools import cache

from casadi_contact.samples.draw import draw_samples
from casadi_contact.samples.reference import ReferenceMotion, reference_motion
from casadi_contact.samples.settings import SamplingSettings
from tests.support import two_spheres
from tests.support.two_spheres import TwoSpheres, knee

SETTINGS = SamplingSettings(scale=0.003, frames=21, chunk_size=20, seed=5)


@cache
def sphere_motion() -> ReferenceMotion:
    """The reference motion that samples are drawn around."""
    model = TwoSpheres(knee())
    return reference_motion(model, two_spheres.cycles(model)[0], SETTINGS)[0]


def draw(path, executor, settings=SETTINGS, **options):
    """Draw the samples into a file, as `draw_samples`."""
    return draw_samples(
        knee(), sphere_motion(), path, settings=settings, executor=executor, models=two_spheres.models, **options
    )
