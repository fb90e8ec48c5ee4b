from __future__ import annotations

import time

import numpy as np
import pytest

from skinmap.errors import BrokenPluginError
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.live import check_source
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.simulated_source import SimulatedSource
from skinmap.live.sources.source import Block, Source, SourceEnded, StreamInfo

INFO = StreamInfo("planted", ("arm",), (3,), 50.0)


class Good(Source):
    """Keeps the contract; what inherits from it breaks one promise."""

    dtype: object = np.uint8
    value: float = 5
    step = 1.0

    def __init__(self) -> None:
        super().__init__(INFO)
        self.now = 0.0
        self.closed = False

    def block(self) -> object:
        self.now += self.step
        values = np.full((1, 3), self.value, self.dtype)
        return Block(np.array([self.now]), values, time.perf_counter())

    def read(self, timeout: float):
        if self.closed:
            raise SourceEnded
        return self.block()

    def close(self) -> None:
        self.closed = True


def test_our_sources_keep_the_contract(icub):
    check_source(Good)
    check_source(lambda: SimulatedSource(icub, parts=["left_hand"], speed=100.0))
    values = np.arange(90, dtype=np.uint8).reshape(30, 3)
    check_source(lambda: Playback(RecordedStream(INFO, np.arange(30) / 50, values)))
    check_source(
        lambda: Playback(RecordedStream(INFO, np.arange(30) / 50, values), speed=np.inf, loop=False)
    )


class NotDerived:
    def read(self, timeout: float):
        return None

    def close(self) -> None:
        pass


class OtherInfo(Good):
    def __init__(self) -> None:
        super().__init__()
        self._info = {"parts": 1}


class OtherCounts(Good):
    counts = {"lost": 3}  # noqa: RUF012


class DegreesAsText(Good):
    def angles_at(self, time: float) -> object:
        return {"elbow": "90 deg"}


class Silent(Good):
    def read(self, timeout: float):
        return None


class Slow(Good):
    def read(self, timeout: float):
        began = time.perf_counter()
        while time.perf_counter() - began < 1.5:
            pass
        return super().read(timeout)


class Bare(Good):
    def block(self) -> object:
        return np.zeros((1, 3))


class Empty(Good):
    def block(self) -> object:
        return Block(np.zeros(0), np.zeros((0, 3), np.uint8), 0.0)


class Wide(Good):
    def block(self) -> object:
        return Block(np.zeros(1), np.zeros((1, 4), np.uint8), 0.0)


class Typed(Good):
    dtype = np.float64


class Infinite(Good):
    dtype, value = np.float32, np.inf


class Loud(Good):
    dtype, value = np.float32, 256


class Backwards(Good):
    step = -1.0


class Ahead(Good):
    def block(self) -> object:
        return Block(np.zeros(1), np.zeros((1, 3), np.uint8), time.perf_counter() + 100)


class Failing(Good):
    def block(self) -> object:
        raise KeyError("fault")


class ClosedOnce(Good):
    def close(self) -> None:
        if self.closed:
            raise ValueError("twice")
        super().close()


class NeverEnds(Good):
    def close(self) -> None:
        pass


class FailsAfter(Good):
    def read(self, timeout: float):
        if self.closed:
            raise ValueError("closed file")
        return super().read(timeout)


class Forgets(Playback):
    """A recording that cannot be led back."""

    def __init__(self) -> None:
        values = np.arange(9, dtype=np.uint8).reshape(3, 3)
        super().__init__(RecordedStream(INFO, np.arange(3.0), values))
        self.speed = np.inf

    def seek(self, seconds: float) -> None:
        super().seek(2.0)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (NotDerived, "NotDerived does not derive from skinmap.live.Source"),
        (lambda: 1 / 0, "cannot be opened: ZeroDivisionError"),
        (OtherInfo, "info is a dict, expected StreamInfo"),
        (OtherCounts, "counts is a dict, expected Counts"),
        (DegreesAsText, "angles_at gives {'elbow': '90 deg'}, expected angles"),
        (Silent, r"nothing came within 0\.3 s"),
        (Slow, r"read takes .* s with a timeout of 0\.2 s"),
        (Bare, "read gives a ndarray, expected a Block"),
        (Empty, "read gives a block without samples"),
        (Wide, "4 values in a sample, info states 3"),
        (Typed, "values are float64, expected uint8 or float32"),
        (Infinite, "values hold NaN or infinity"),
        (Loud, "pressures must lie within 0 to 255 counts"),
        (Backwards, "times run backwards"),
        (Ahead, "arrived lies in the future"),
        (Failing, r"read fails: KeyError\('fault'\)"),
        (ClosedOnce, "close, called twice, fails"),
        (NeverEnds, "read after close must raise SourceEnded"),
        (FailsAfter, "read after close raises ValueError"),
        (Forgets, "gives other samples when it is led back to its beginning"),
    ],
)
def test_broken_promises_are_named(make, said):
    with pytest.raises(BrokenPluginError, match=said):
        check_source(make, seconds=0.3)
