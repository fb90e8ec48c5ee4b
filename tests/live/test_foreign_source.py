from __future__ import annotations

import time

import numpy as np
import pytest

import skinmap.live
from skinmap.errors import BrokenPluginError
from skinmap.live.sources.open_source import sources
from skinmap.live.sources.playback import Playback
from skinmap.live.sources.receiver import choose_parts
from skinmap.live.sources.source import (
    Block,
    Counts,
    Relay,
    Seekable,
    Source,
    SourceEnded,
    StreamInfo,
    as_source,
)

INFO = StreamInfo("planted", ("arm", "hand"), (3, 2), 50.0)


class Bare:
    """All that a source needs, deriving from nothing."""

    def __init__(self):
        self.info, self.closed = INFO, 0

    def read(self, timeout):
        if self.closed:
            raise SourceEnded
        return Block(np.zeros(1), np.zeros((1, 5), np.uint8), time.perf_counter())

    def close(self):
        self.closed += 1


class Rich(Bare):
    """A bare source with all that may be there."""

    def __init__(self):
        super().__init__()
        self.counts, self.last_seen, self.alive, self.speed = Counts(lost=3), 7.0, False, 2.0

    def angles_at(self, time):
        return {"elbow": time}


class Led(Bare):
    """A recording of somebody else."""

    speed, loop, duration, position = 1.0, False, 4.0, 0.0

    def seek(self, seconds):
        self.position = seconds


def told(source):
    found = (source.counts.lost, source.alive, source.speed, source.seekable)
    return (*found, dict(source.angles_at(0.5)))


def test_a_source_of_ours_is_taken_as_it_is():
    source = Playback(INFO, np.arange(3.0), np.zeros((3, 5), np.uint8))
    assert as_source(source) is source


def test_what_a_bare_source_lacks_has_the_defaults_of_the_contract():
    theirs = Bare()
    source = as_source(theirs)
    assert isinstance(source, Source)
    assert not isinstance(source, Seekable)
    assert told(source) == (0, True, 1.0, False, {})
    assert np.isnan(source.last_seen)
    assert len(source.read(0.1)) == 1
    source.close()
    assert theirs.closed == 1


def test_what_a_foreign_source_has_is_asked():
    source = as_source(Rich())
    assert told(source) == (3, False, 2.0, False, {"elbow": 0.5})
    assert source.last_seen == 7.0


def test_a_foreign_recording_is_led():
    theirs = Led()
    source = as_source(theirs)
    assert isinstance(source, Seekable)
    assert source.seekable
    source.speed, source.loop = 3.0, True
    source.seek(2.5)
    assert (theirs.speed, theirs.loop, theirs.position) == (3.0, True, 2.5)
    assert (source.speed, source.loop, source.position, source.duration) == (3.0, True, 2.5, 4.0)


def test_what_is_missing_is_said():
    with pytest.raises(BrokenPluginError, match="object has no 'info', 'read', 'close'; a source"):
        as_source(object())


def test_a_relay_changes_nothing_that_it_does_not_define():
    inner = as_source(Rich())
    for source in (Relay(inner), choose_parts(inner, ["hand"])):
        assert told(source) == told(inner)
        assert source.last_seen == 7.0
    assert choose_parts(inner, ["hand"]).info.widths == (2,)
    led = Relay(as_source(Led()))
    assert led.seekable
    assert not isinstance(led, Seekable)


def open_bare(address, **how):
    return {"": Bare(), "none": object()}[address]


def test_a_plug_in_that_derives_from_nothing_opens_by_its_name(monkeypatch):
    monkeypatch.setitem(sources._own, "bare", open_bare)
    source = skinmap.live.open_source("bare")
    assert isinstance(source, Source)
    assert source.info == INFO
    with pytest.raises(BrokenPluginError, match="object has no 'info'"):
        skinmap.live.open_source("bare:none")
