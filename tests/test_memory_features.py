"""Features of a channel that remembers: a recording has those of a stream."""

from __future__ import annotations

import numpy as np
import pytest

from skinmap.memory_features import FEATURES, MemoryState


@pytest.mark.parametrize("seconds", [0.5, 0.06, 0.0])
def test_rows_at_once_give_the_bits_of_one_after_the_other(rng, seconds):
    values = rng.normal(0, 0.1, (130, 5)).cumsum(axis=0)
    single, many = (MemoryState(values[0], 50.0, seconds) for _ in "12")
    wanted = [single.step(row) for row in values]
    parts = np.split(values, [0, 7, 7, 57, 130])  # within, at and over the turn of a window
    found = np.concatenate([many.steps(part) for part in parts])
    assert found.shape == (130, FEATURES - 1, 5)
    np.testing.assert_array_equal(found, wanted)
