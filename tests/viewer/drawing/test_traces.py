import numpy as np
import pytest

from viewer.drawing.touches.traces import ROOM, SAMPLES, History


def test_history_gives_back_what_was_felt_oldest_first():
    history = History({"a": 3, "b": 2}, seconds=10.0)
    for k in range(100):
        history.add(0.02 * k, {"a": np.array([k, 2 * k, 255])})
    times, values = history.traces("a", np.array([1, 2]))
    np.testing.assert_allclose(times, 0.02 * np.arange(100), rtol=0, atol=1e-12)
    # Half floats hold whole numbers up to 2048 exactly.
    np.testing.assert_array_equal(values, np.column_stack([2 * np.arange(100), np.full(100, 255)]))
    _, silent = history.traces("b", np.array([0]))
    assert np.isnan(silent).all()


def test_history_never_grows_and_forgets_the_oldest():
    history = History({"a": 4})

    def size():
        return sum(kept.nbytes for kept in history._values.values()) + history._times.nbytes

    before = size()
    for k in range(3 * SAMPLES):
        history.add(0.02 * k, {"a": np.full(4, k % 256)})
    assert size() == before
    times, values = history.traces("a", np.array([0]))
    assert len(times) == SAMPLES
    assert (np.diff(times) > 0).all()
    assert values[-1, 0] == (3 * SAMPLES - 1) % 256


@pytest.mark.parametrize("taxels", [100, 20_000, 100_000])
def test_history_of_any_skin_fits_into_its_room(taxels):
    history = History({"a": taxels})
    assert history.samples * taxels <= max(ROOM, 2 * taxels)
    assert history.samples * history.step == pytest.approx(10.0)


def test_history_thins_out_fast_streams_and_starts_again_when_led_back():
    history = History({"a": 1}, seconds=10.0)
    for k in range(1000):  # 1 kHz for a second: 50 of them are kept
        history.add(1e-3 * k, {"a": [k % 256]})
    times, _ = history.traces("a", np.array([0]))
    assert 45 <= len(times) <= 56  # a sample in every 18 to 20 ms
    history.add(0.5, {"a": [7]})
    times, values = history.traces("a", np.array([0]))
    assert times.tolist() == [0.5]
    assert values.tolist() == [[7.0]]
    history.add(float("nan"), {"a": [8]})
    assert len(history.traces("a", np.array([0]))[0]) == 1
