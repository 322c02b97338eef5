"""Kernels that tests compile go to a folder of their own, not to the user's cache."""

import os

import pytest


@pytest.fixture(scope="session", autouse=True)
def _kernel_cache(tmp_path_factory):
    os.environ["CASADI_CONTACT_CACHE"] = str(tmp_path_factory.mktemp("kernels"))
    yield
    del os.environ["CASADI_CONTACT_CACHE"]
