"""Arrow's columns as numbers, without pandas."""

import numpy as np
import pyarrow as pa
import pytest

from pumaid.io.formats import floats


@pytest.mark.parametrize("missing", [0.0, 0.3, 1.0])
def test_any_slice_has_its_own_numbers(missing):
    """What lacks is told by single bits, which a slice may begin with anywhere."""
    rng = np.random.default_rng(1)
    whole = pa.array(rng.normal(size=70), mask=rng.random(70) < missing)
    for start, stop in np.sort(rng.integers(0, 71, (100, 2)), axis=1).tolist():
        part = whole.slice(start, stop - start)
        wanted = np.array([np.nan if value is None else value for value in part.to_pylist()], dtype=float)
        np.testing.assert_array_equal(floats(part), wanted)
