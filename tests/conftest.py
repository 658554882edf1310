"""Settings that must stand before numpy is imported; what commands keep goes to a folder of the tests' own."""

import os

import pytest

# Matrices here are small: threads of the linear algebra library only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")


@pytest.fixture(autouse=True, scope="session")
def _own_cache(tmp_path_factory):
    """No test finds, or leaves, anything in the user's cache."""
    os.environ["PUMAID_CACHE"] = str(tmp_path_factory.mktemp("cache"))
