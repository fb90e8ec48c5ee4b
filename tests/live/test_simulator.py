from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import InvalidArrayError, UnknownNameError
from skinmap.live import open_source
from skinmap.live.sources.simulated_source import REST, SimulatedSource
from skinmap.live.sources.source import Source, SourceEnded, blocks

PARTS = ("left_foot", "left_forearm")


def simulated(icub, **how) -> SimulatedSource:
    how = {"parts": PARTS, "speed": np.inf, "seconds": 12.0, **how}
    return SimulatedSource(icub, **how)


def played(source: Source) -> tuple[np.ndarray, np.ndarray]:
    all_blocks = list(blocks(source))
    source.close()
    times = np.concatenate([block.times for block in all_blocks])
    return times, np.concatenate([block.values for block in all_blocks])


def test_simulation_keeps_its_rate_and_repeats_with_its_seed(icub):
    source = simulated(icub)
    assert isinstance(source, Source)
    assert source.info.widths == (250, 240)
    times, values = played(source)
    np.testing.assert_allclose(times, np.arange(600) / 50.0, rtol=0, atol=1e-12)
    assert values.shape == (600, 490)
    assert values.dtype == np.uint8
    assert np.array_equal(values, played(simulated(icub))[1])
    assert not np.array_equal(values, played(simulated(icub, seed=1))[1])


def test_simulation_touches_what_its_truth_says(icub):
    source = simulated(icub)
    times, values = played(source)
    assert len(source.truth) >= 5
    felt = {part: np.zeros(len(times), bool) for part in PARTS}
    for touch in source.truth:
        felt[touch.part] |= (times >= touch.began) & (times < touch.ended)
    for part in PARTS:
        loud = (values[:, source.info.part_slice(part)] > 40).any(axis=1)
        # 40 counts are 30 standard deviations of the noise: only touches get there.
        assert loud.any()
        assert not (loud & ~felt[part]).any()


def test_simulation_of_raw_values_falls_from_rest(icub):
    raw = played(simulated(icub, kind="raw"))[1]
    pressed = played(simulated(icub))[1]
    assert np.array_equal(raw, REST - np.minimum(pressed, REST))


def test_simulation_paced_by_the_clock_starts_at_once_and_closes(icub):
    source = open_source("sim", robot=icub, parts=["left_hand"], speed=1e-6)
    assert source.info.parts == ("left_hand",)
    assert len(source.read(60.0)) == 1
    assert source.read(0.01) is None  # the next is due in hours
    source.close()
    source.close()
    with pytest.raises(SourceEnded):
        source.read(1.0)


def test_simulation_refuses_nonsense(icub):
    with pytest.raises(UnknownNameError, match="no part 'tail'"):
        simulated(icub, parts=["tail"])
    with pytest.raises(UnknownNameError, match="no gesture 'kick'"):
        simulated(icub, gestures=["kick"])
    with pytest.raises(InvalidArrayError, match="speed must be above 0"):
        simulated(icub, speed=0.0)
    with pytest.raises(InvalidArrayError, match="rate must lie in"):
        simulated(icub, rate=0.0)
