"""Measured input that is not part of the project: tests that need it skip where it is absent."""

import os
from pathlib import Path

import pytest


def shared_file(name: str) -> Path:
    """A file of the shared data folder ($CASADI_CONTACT_SHARED or ../shared); skips the test without it."""
    folder = Path(os.environ.get("CASADI_CONTACT_SHARED", Path(__file__).parents[3] / "shared"))
    path = folder / name
    if not path.is_file():
        pytest.skip(f"measured data {name} is not here: set CASADI_CONTACT_SHARED to the folder that holds it")
    return path
