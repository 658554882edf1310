"""Short arrays: the same numbers as numpy's own steps, which take longer to call."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pumaid.maths.short import gradient, lengths, mean, median
from pumaid.preprocessing.options import DEFAULTS
from pumaid.preprocessing.rest import FirstRest
from pumaid.preprocessing.speed import slopes, slopes_by

NUMBERS = arrays(np.float64, st.integers(1, 60), elements=st.floats(-1e6, 1e6))


@given(NUMBERS)
def test_mean_and_median_are_numpys(values):
    """To the last bit, of odd and even counts; the values stay as they are."""
    before = values.copy()
    assert (mean(values), median(values)) == (float(np.mean(values)), float(np.median(values)))
    assert np.array_equal(values, before)


@given(arrays(np.float64, st.integers(2, 60), elements=st.floats(-1e6, 1e6)))
def test_gradients_are_numpys(values):
    """At the ends and between, to rounding; the values stay as they are."""
    before = values.copy()
    assert np.allclose(gradient(values), np.gradient(values), rtol=1e-12, atol=1e-9)
    assert np.array_equal(values, before)


@given(st.lists(st.integers(0, 50), min_size=1, max_size=20, unique=True), st.integers(1, 9))
def test_lengths_add_up(starts, more):
    """Groups follow one another up to the end; of none there are none."""
    starts = np.array(sorted(starts))
    size = int(starts[-1]) + more
    found = lengths(starts, size)
    assert found.tolist() == np.diff([*starts, size]).tolist()
    assert found.sum() == size - starts[0]
    assert len(lengths(starts[:0], 0)) == 0


@given(st.integers(2, 40), st.integers(0, 2**32 - 1))
def test_slopes_over_several_widths_are_straight_lines_through_neighbours(size, seed):
    """Each width as if it were the only one, and as least squares give it."""
    random = np.random.default_rng(seed)
    time, values = np.cumsum(random.uniform(0.5, 1.5, size)), random.normal(size=size)
    widths = (1, 4, 2)
    for half, found in zip(widths, slopes_by(time, values, widths), strict=True):
        near = [slice(max(0, k - half), k + half + 1) for k in range(size)]
        wanted = [np.polyfit(time[part] - time[part].mean(), values[part], 1)[0] for part in near]
        assert np.allclose(found, wanted, rtol=1e-9, atol=1e-9)
        assert np.allclose(found, slopes(time, values, half), rtol=1e-12, atol=1e-12)


@given(st.lists(st.integers(1, 20_000), min_size=1, max_size=8), st.integers(0, 2**32 - 1))
def test_the_first_rest_does_not_depend_on_batches(sizes, seed):
    """Found behind the same sample, however the samples come."""
    random = np.random.default_rng(seed)
    time = np.arange(sum(sizes)) * 0.002
    # Moves, but for a second somewhere.
    rest = random.uniform(0.0, 1.2 * time[-1] + 0.01)
    moving = np.minimum(time, rest) + np.maximum(0.0, time - rest - 1.0)
    position = np.stack([0.3 * moving, 0.0 * time], axis=1) + random.normal(scale=1e-5, size=(len(time), 2))
    whole = FirstRest(DEFAULTS).take(time, position)
    search, at, found = FirstRest(DEFAULTS), 0, None
    for size in sizes:
        found = search.take(time[at : at + size], position[at : at + size])
        at += size
        if found is not None:
            break
    assert found == whole
    if whole is not None:
        assert rest - 0.25 < time[whole] < rest + 1.25
