"""Kernels that tests compile go to a folder of their own, not to the user's cache."""

import os

import pytest


def pytest_addoption(parser):
    """How many mutated files tests/fuzz reads."""
    parser.addoption("--mutations", type=int, default=520, help="mutated files over all readers (tests/fuzz)")


@pytest.fixture(scope="session", autouse=True)
def _kernel_cache(tmp_path_factory):
    os.environ["CASADI_CONTACT_CACHE"] = str(tmp_path_factory.mktemp("kernels"))
    yield
    del os.environ["CASADI_CONTACT_CACHE"]
