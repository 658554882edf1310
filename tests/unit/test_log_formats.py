"""Arrow's columns as numbers, without pandas."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from pumaid.io.formats import floats

SAMPLES = Path(__file__).parents[2] / "sample_logs"

READ = """
import sys
from pumaid.io.recipe import read_recipe
from pumaid.io.log_reader import LogReader
from pumaid.io.paths import expand
rows = sum(len(log) for log in LogReader(expand([sys.argv[1]]), read_recipe(sys.argv[2])))
print(rows > 1000, "pandas" in sys.modules)
"""


@pytest.mark.parametrize("log", ["pendulum/logs/session_01.csv", "puma560/logs/session_01.parquet"])
def test_reading_logs_loads_no_pandas(log):
    """It takes longer to load than a million rows to read."""
    path = SAMPLES / log
    words = [sys.executable, "-c", READ, path, path.parents[1] / "recipe.yaml"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "False"]


@pytest.mark.parametrize("missing", [0.0, 0.3, 1.0])
def test_any_slice_has_its_own_numbers(missing):
    """What lacks is told by single bits, which a slice may begin with anywhere."""
    rng = np.random.default_rng(1)
    whole = pa.array(rng.normal(size=70), mask=rng.random(70) < missing)
    for start, stop in np.sort(rng.integers(0, 71, (100, 2)), axis=1).tolist():
        part = whole.slice(start, stop - start)
        wanted = np.array([np.nan if value is None else value for value in part.to_pylist()], dtype=float)
        np.testing.assert_array_equal(floats(part), wanted)
