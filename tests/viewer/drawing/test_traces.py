import numpy as np
import pytest

from skinmap.live.contacts.named_touch import Moment
from viewer.drawing.touches.traces import SAMPLES, SECONDS, traces
from viewer.playing.recent_moments import MEMORY, History, size


def kept(samples):
    """What is remembered for plots of pressures {part: values} at times."""
    history = History(SECONDS, SAMPLES, spread=True)
    for time, pressures in samples:
        history.add(Moment(time, {part: np.asarray(v) for part, v in pressures.items()}))
    return history.moments()


def test_traces_are_what_was_felt_oldest_first():
    moments = kept((0.02 * k, {"a": [k, 2 * k, 255.0], "b": [0.25, 0.5]}) for k in range(100))
    times, values = traces(moments, "a", np.array([1, 2]))
    np.testing.assert_allclose(times, 0.02 * np.arange(100), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(values, np.column_stack([2 * np.arange(100), np.full(100, 255)]))
    np.testing.assert_array_equal(traces(moments, "b", np.array([1]))[1], np.full((100, 1), 0.5))
    assert np.isnan(traces(moments, "c", np.array([0]))[1]).all()
    assert traces((), "a", np.array([0, 1]))[1].shape == (0, 2)


def test_what_is_plotted_never_grows_and_the_oldest_is_forgotten():
    moments = kept((0.02 * k, {"a": [k % 256] * 4}) for k in range(3 * SAMPLES))
    times, values = traces(moments, "a", np.array([0]))
    assert len(times) == SAMPLES
    assert (np.diff(times) > 0).all()
    assert values[-1, 0] == (3 * SAMPLES - 1) % 256


@pytest.mark.parametrize("taxels", [100, 20_000, 100_000])
def test_plots_of_any_skin_reach_back_as_far_in_the_room_there_is(taxels):
    pressures = np.linspace(0.1, 200.1, taxels)  # not whole: four bytes each
    moments = kept((0.02 * k, {"a": pressures}) for k in range(600))
    assert sum(map(size, moments)) <= MEMORY
    assert moments[-1].time - moments[0].time > 0.9 * SECONDS


def test_fast_streams_are_thinned_out_and_a_recording_led_back_starts_again():
    fast = [(1e-3 * k, {"a": [k % 256]}) for k in range(1000)]  # 1 kHz for a second
    assert 45 <= len(kept(fast)) <= 56  # a sample in every 18 to 20 ms
    moments = kept([*fast, (0.5, {"a": [7]})])
    times, values = traces(moments, "a", np.array([0]))
    assert times.tolist() == [0.5]
    assert values.tolist() == [[7.0]]
