from __future__ import annotations

import numpy as np
import pytest

import skinmap.live
from skinmap.errors import BrokenPluginError
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.live.sources.open_source import sources
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.source import (
    Counts,
    Relay,
    Seekable,
    Source,
    SourceEnded,
    StreamInfo,
    choose_parts,
)

INFO = StreamInfo("planted", ("arm", "hand"), (3, 2), 50.0)


class Rich(Source):
    """A source that overrides all that it may."""

    counts, last_seen, alive, speed = Counts(lost=3), 7.0, False, 2.0

    def read(self, timeout):
        raise SourceEnded

    def close(self):
        pass

    def angles_at(self, time):
        return {"elbow": time}


def told(source):
    found = (source.counts.lost, source.alive, source.speed, source.seekable)
    return (*found, dict(source.angles_at(0.5)))


def test_a_relay_changes_nothing_that_it_does_not_define():
    inner = Rich(INFO)
    for source in (Relay(inner), choose_parts(inner, ["hand"])):
        assert told(source) == told(inner)
        assert source.last_seen == 7.0
    assert choose_parts(inner, ["hand"]).info.widths == (2,)
    led = Relay(Playback(RecordedStream(INFO, np.arange(3.0), np.zeros((3, 5), np.uint8))))
    assert led.seekable
    assert not isinstance(led, Seekable)


def test_a_plug_in_that_gives_something_else_is_refused(monkeypatch):
    monkeypatch.setitem(sources._own, "bare", lambda address, **how: object())
    with pytest.raises(BrokenPluginError, match="gives a object, which does not derive from"):
        skinmap.live.open_source("bare")
