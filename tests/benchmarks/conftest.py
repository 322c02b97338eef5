"""What benchmarks compile has the flags that a user gets, not the quick ones of the tests."""

import pytest


@pytest.fixture(autouse=True)
def _as_shipped(as_shipped):
    pass
