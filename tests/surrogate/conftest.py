"""A surrogate's file, to damage and to forge."""

import pytest

from casadi_contact.scenes.loading import load_scene
from tests.support.random_surrogates import random_surrogate


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "knee.h5"
    random_surrogate(load_scene("knee"), "patch").save(path)
    return path
