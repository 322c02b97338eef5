"""Kernels of tests go to a folder of their own; each process has one thread, as what tests compute is small."""

import os
from functools import partial

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(variable, "1")  # read when NumPy and torch are first imported
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # else every command that a test starts compiles all its modules

import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

import casadi_contact as cc  # noqa: E402
from casadi_contact.core.compiler import CFLAGS_VARIABLE  # noqa: E402
from casadi_contact.surrogate.calibration import CalibrationSettings, calibrate  # noqa: E402
from tests.support.compiler import QUICK, flags_of_the_library  # noqa: E402

# The same examples every time, however long the machine takes for one.
settings.register_profile("reproducible", derandomize=True, deadline=None)
settings.load_profile("reproducible")


@pytest.fixture(scope="session", autouse=True)
def _kernel_cache(tmp_path_factory):
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "kernels"  # compiled once for all workers
    folder.mkdir(mode=0o700, exist_ok=True)
    os.environ["CASADI_CONTACT_CACHE"] = str(folder)
    yield
    del os.environ["CASADI_CONTACT_CACHE"]


@pytest.fixture(scope="session", autouse=True)
def _quick_compilation():
    with pytest.MonkeyPatch.context() as patch:
        if CFLAGS_VARIABLE not in os.environ:
            patch.setenv(CFLAGS_VARIABLE, QUICK)
        yield


@pytest.fixture(scope="module")
def knee():
    """The shipped surrogate of the artificial knee."""
    return cc.load_surrogate("knee")


@pytest.fixture(scope="module")
def quick_calibration():
    """Training calibrates with a classifier of fewer iterations than a user's."""
    with pytest.MonkeyPatch.context() as patch:
        quick = partial(calibrate, settings=CalibrationSettings(iterations=25))
        patch.setattr("casadi_contact.workflow.stages.calibrate", quick)
        yield


@pytest.fixture
def as_shipped():
    """What the test compiles has the flags that a user gets."""
    with flags_of_the_library():
        yield
