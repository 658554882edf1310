"""However samples are cut up and put together again, the triangle is that of all of them."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pumaid.maths.triangle import Triangle


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), columns=st.integers(1, 6), data=st.data())
def test_any_split_and_order_of_merging(seed, columns, data):
    """Pieces of any sizes, merged in any order, pairwise or at once, give one factor."""
    rng = np.random.default_rng(seed)
    sizes = data.draw(st.lists(st.integers(1, 12), min_size=1, max_size=8))
    rows = rng.normal(size=(sum(sizes), columns)) * 10.0 ** rng.integers(-3, 4, columns)
    target, names = rng.normal(size=sum(sizes)), tuple("abcdef"[:columns])
    whole = Triangle.of(names, rows, target)
    pieces = [
        Triangle.of(names, part, aim)
        for part, aim in zip(
            np.split(rows, np.cumsum(sizes)[:-1]), np.split(target, np.cumsum(sizes)[:-1]), strict=True
        )
    ]
    order = data.draw(st.permutations(pieces))
    pairwise = order[0]
    for piece in order[1:]:
        pairwise = pairwise + piece
    # Against the Gram matrix, which is unique also where there are fewer samples than columns.
    size = np.linalg.norm(np.column_stack([rows, target]), axis=0)
    gram = whole.factor.T @ whole.factor / np.outer(size, size)
    for merged in (pairwise, Triangle.merge(order)):
        assert merged.count == sum(sizes)
        assert np.allclose(merged.factor.T @ merged.factor / np.outer(size, size), gram, atol=1e-12)
