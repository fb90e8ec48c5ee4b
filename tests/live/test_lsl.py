from __future__ import annotations

import json
import os
import socket
import threading
import time
import uuid
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinmap.errors import (
    InvalidArrayError,
    MessageError,
    OutputError,
    SkinMismatchError,
    SkinWarning,
    UnknownNameError,
)
from skinmap.live import check_source, open_publisher, open_source
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from skinmap.live.network import lsl_stream
from skinmap.live.network.lsl_stream import load_lsl, read_description, settings, split_scope
from skinmap.live.sources.source import StreamInfo, check_skin, of_robot

DEADLINE = 30.0  # [s]; only a fault takes as long
INFO = StreamInfo("demo", ("arm", "hand"), (3, 2), 50.0, "raw", "icub", {"arm": "ab"})


@pytest.fixture
def name() -> str:
    """No other test on this machine has it."""
    return f"test-{uuid.uuid4().hex[:12]}"


@pytest.fixture(scope="module")
def lsl():
    return load_lsl("")


def collect(source, count: int) -> tuple[np.ndarray, np.ndarray]:
    times, values, until = [], [], time.perf_counter() + DEADLINE
    while sum(map(len, times)) < count and time.perf_counter() < until:
        block = source.read(0.2)
        if block is not None:
            times.append(block.times)
            values.append(block.values)
    return np.concatenate(times), np.concatenate(values)


def wait_until(holds) -> bool:
    until = time.perf_counter() + DEADLINE
    while not holds() and time.perf_counter() < until:
        threading.Event().wait(0.01)
    return holds()


def test_samples_arrive_whole_in_order_and_in_our_clock(name):
    sent = np.random.default_rng(3).random((200, 5)).astype(np.float32)
    with open_publisher(f"lsl:{name}", INFO) as publisher:
        source = open_source(f"lsl:{name}")
        for key in ("parts", "widths", "rate", "kind", "robot", "fingerprints"):
            assert getattr(source.info, key) == getattr(INFO, key), key
        assert (source.info.name, source.info.clock) == (name, "local")
        assert publisher.wait_for_followers(DEADLINE)
        publisher.send_samples("raw", 7.0 + np.arange(200) / 50, sent)
        now = time.perf_counter()
        times, values = collect(source, 200)
        np.testing.assert_array_equal(values, sent)
        # LSL's clock and ours are the same on this machine; its estimate of the difference is
        # good to a millisecond, and the last sample was stamped with the moment of its sending.
        np.testing.assert_allclose(np.diff(times), 0.02, rtol=0, atol=1e-3)
        assert now - 1.0 < times[-1] < now + 1e-2
        counts = source.counts
        assert (counts.dropped, counts.late, counts.repeated) == (0, 0, 0)
        source.close()


@pytest.mark.parametrize("speed", [4.0, 0.5])
def test_a_played_recording_keeps_its_speed_in_even_times_that_never_run_back(lsl, name, speed):
    with open_publisher(f"lsl:{name}", INFO, speed=speed) as publisher:
        source = open_source(f"lsl:{name}")
        assert source.info.rate == 50.0 * speed
        assert publisher.wait_for_followers(DEADLINE)
        due = iter(lsl.local_clock() + 0.5 / speed * np.arange(4))
        publisher._times._clock = lambda: next(due)
        for first in (0, 25, 50, 0):  # the last one starts again
            rows = np.arange(first, first + 25)
            publisher.send_samples("raw", rows / 50, np.ones((25, 5)))
        times, _ = collect(source, 100)
        assert len(times) == 100
        np.testing.assert_allclose(np.diff(times), 0.02 / speed, rtol=0, atol=1e-3)
        counts = source.counts
        assert (counts.repeated, counts.late, counts.restarts) == (0, 0, 0)
        source.close()


def test_stream_gives_the_parts_asked_for(name):
    with open_publisher(f"lsl:{name}", INFO) as publisher:
        source = open_source(f"lsl:{name}", parts=["hand"])
        assert publisher.wait_for_followers(DEADLINE)
        publisher.send_samples("raw", np.zeros(1), np.arange(5.0)[None])
        assert collect(source, 1)[1].tolist() == [[3.0, 4.0]]
        source.close()


def test_stream_keeps_the_contract_of_sources(name):
    stop = threading.Event()
    publisher = open_publisher(f"lsl:{name}", INFO)

    def send():
        step = 0
        while not stop.wait(0.002):
            publisher.send_samples("raw", np.array([step / 500]), np.ones((1, 5)))
            step += 1

    sending = threading.Thread(target=send)
    sending.start()
    check_source(lambda: open_source(f"lsl:{name}"))
    stop.set()
    sending.join()
    publisher.close()


def test_unknown_stream_names_those_that_exist(name, monkeypatch):
    monkeypatch.setattr("skinmap.live.network.lsl_stream.WAIT", 0.3)
    began = time.perf_counter()
    refused = pytest.raises(UnknownNameError, match=f"no LSL stream 'nothing{name}'; .*{name}")
    with open_publisher(f"lsl:{name}", INFO), refused:
        open_source(f"lsl:nothing{name}")
    assert time.perf_counter() - began < DEADLINE


def outlet(lsl, name: str, channels: int = 5, form: str = "float32", rate: float = 50.0):
    """A stream of somebody who does not know us."""
    return lsl.StreamOutlet(
        lsl.StreamInfo(name, "EEG", channels, rate, form, uuid.uuid4().hex), max_buffered=5
    )


def test_two_streams_of_one_name_are_told_apart_by_their_identifiers(name, lsl):
    one, other = outlet(lsl, name), outlet(lsl, name, channels=7)
    uids = [each.get_info().uid() for each in (one, other)]
    with pytest.raises(UnknownNameError) as raised:
        open_source(f"lsl:{name}")
    message = str(raised.value)
    assert f"{name} (2 have the name)" in message
    for uid in uids:
        assert f"lsl:{name}#{uid[:8]} on {socket.gethostname()}" in message
    source = open_source(f"lsl:{name}#{uids[1][:8]}")
    assert source.info.channels == 7
    source.close()


def test_a_name_that_is_taken_is_refused(name):
    refused = pytest.raises(OutputError, match=f"an LSL stream named '{name}' is there already: ")
    with open_publisher(f"lsl:{name}", INFO), refused:
        open_publisher(f"lsl:{name}", INFO)


def test_stream_of_others_is_one_part_of_pressures(name, lsl):
    theirs = outlet(lsl, name, form="int16")
    source = open_source(f"lsl:{name}")
    assert (source.info.parts, source.info.widths) == (("all",), (5,))
    assert source.info.kind == "pressure"
    assert theirs.wait_for_consumers(DEADLINE)
    theirs.push_sample([1, 2, 3, 4, 300])
    values = collect(source, 1)[1]
    assert values.tolist() == [[1, 2, 3, 4, 300]]
    assert values.dtype == np.float32
    source.close()


@pytest.mark.skipif(np.dtype("l").itemsize < 8, reason="LSL reads these with a long of 64 bits")
def test_stream_of_long_integers_is_read(name, lsl):
    theirs = outlet(lsl, name, form="int64")
    source = open_source(f"lsl:{name}")
    assert theirs.wait_for_consumers(DEADLINE)
    theirs.push_sample([1, 2, 3, 4, 255])
    assert collect(source, 1)[1].tolist() == [[1, 2, 3, 4, 255]]
    source.close()


def test_stream_of_text_is_refused(name, lsl):
    theirs = outlet(lsl, name, channels=1, form="string")
    with pytest.raises(MessageError, match="sends no numbers that Skinmap reads: string; it reads"):
        open_source(f"lsl:{name}")
    del theirs


def test_stream_of_another_skin_is_refused(name, lsl, icub):
    theirs = outlet(lsl, name)
    said = r"has 5 channels; none of torso, .* has so many on 'iCub'; --robot names another"
    with pytest.raises(SkinMismatchError, match=said):
        open_source(f"lsl:{name}", robot=icub)
    with pytest.raises(SkinMismatchError, match="left_hand 48 or 144"):
        open_source(f"lsl:{name}", robot=icub, parts=["left_hand"])
    del theirs


def test_stream_that_names_no_part_is_of_the_one_that_has_so_many_taxels(name, lsl, icub):
    width = len(icub.skin("left_hand"))
    theirs = outlet(lsl, name, channels=width)
    with pytest.raises(SkinMismatchError, match="left_hand, right_hand have so many: give --part"):
        open_source(f"lsl:{name}", robot=icub)
    source = open_source(f"lsl:{name}", robot=icub, parts=["left_hand"])
    assert (source.info.parts, source.info.widths) == (("left_hand",), (width,))
    source.close()
    del theirs


@pytest.mark.parametrize("width", [240, 360, 384])
def test_stream_of_others_may_be_a_whole_live_vector(icub, width):
    info = StreamInfo("theirs", ("all",), (width,), 50.0)
    found = of_robot(info, icub, ["left_forearm"])
    assert (found.parts, found.widths) == (("left_forearm",), (width,))
    check_skin(found, icub)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"kind": "smell"}, "describes 5 smell channels and has 5"),
        ({"version": "9"}, "has a description of version '9', this Skinmap reads 1"),
        ({"channels": "4"}, "describes 6 raw channels and has 5"),
        ({"channels": "-3"}, "describes a part with '-3' channels"),
        ({"channels": "9" * 40}, "describes a part with '9"),
        ({"name": "hand"}, "each once"),
    ],
)
def test_description_that_contradicts_itself_is_refused(name, lsl, change, said):
    found = lsl.StreamInfo(name, "Tactile", 5, 50.0, "float32", "id")
    skin = found.desc().append_child("skinmap")
    skin.append_child_value("version", change.get("version", "1"))
    skin.append_child_value("kind", change.get("kind", "raw"))
    parts = skin.append_child("parts")
    for part, width in ((change.get("name", "arm"), change.get("channels", "3")), ("hand", "2")):
        one = parts.append_child("part")
        one.append_child_value("name", part)
        one.append_child_value("channels", width)
    theirs = lsl.StreamOutlet(found)
    with pytest.raises(MessageError, match=said):
        open_source(f"lsl:{name}")
    del theirs


def test_dead_stream_is_noticed_and_its_return_too(name):
    first = open_publisher(f"lsl:{name}", INFO)
    source = open_source(f"lsl:{name}")
    assert first.wait_for_followers(DEADLINE)
    first.send_samples("raw", np.zeros(1), np.ones((1, 5)))
    assert len(collect(source, 1)[0]) == 1
    first.close()
    assert wait_until(lambda: not source.alive)
    assert source.read(0.0) is None
    with open_publisher(f"lsl:{name}", INFO) as second:
        assert second.wait_for_followers(DEADLINE)
        second.send_samples("raw", np.zeros(1), 2 * np.ones((1, 5)))
        assert collect(source, 1)[1].tolist() == [[2.0] * 5]
        assert source.alive
        assert source.counts.reconnects == 1
    source.close()


def test_stream_that_returns_with_another_skin_is_refused(name):
    first = open_publisher(f"lsl:{name}", INFO)
    source = open_source(f"lsl:{name}")
    first.close()
    assert wait_until(lambda: not source.alive)
    refused = pytest.raises(SkinMismatchError, match="came back with another skin: 10 raw")
    with open_publisher(f"lsl:{name}", replace(INFO, widths=(3, 7))), refused:
        collect(source, 1)
    source.close()


def test_contacts_and_labels_have_streams_of_their_own(name, lsl):
    touch = NamedTouch("arm", np.array([1]), np.zeros(3), "poke", 0.5, identity=3)
    with open_publisher(f"lsl:{name}", INFO, topics=["contacts", "labels"]) as publisher:
        inlets = {}
        for topic in publisher.topics:
            (found,) = lsl.resolve_byprop("name", f"{name}-{topic}", 1, DEADLINE)
            inlets[topic] = lsl.StreamInlet(found)
            inlets[topic].open_stream(DEADLINE)
        publisher.send(Moment(1.0, {}, (touch,)))
        for topic, inlet in inlets.items():
            (text,), _ = inlet.pull_sample(DEADLINE)
            assert json.loads(text)[topic][0]["identity"] == 3
        publisher.close()
        publisher.close()


@pytest.mark.skipif(not hasattr(socket, "SO_BINDTODEVICE"), reason="only Linux has devices")
def test_no_socket_of_a_stream_can_be_reached_from_elsewhere(name):
    before = set(os.listdir("/proc/self/fd"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        publisher = open_publisher(f"lsl:{name}", INFO)
    served = 0
    for number in set(os.listdir("/proc/self/fd")) - before:
        if not Path(f"/proc/self/fd/{number}").is_socket():
            continue
        with socket.socket(fileno=os.dup(int(number))) as one:
            if one.family not in (socket.AF_INET, socket.AF_INET6) or one.getsockname()[1] == 0:
                continue
            served += 1
            tied = one.getsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, 16)
            assert tied.startswith(b"lo\0") or one.getsockname()[0] == "127.0.0.1"
    assert served >= 3  # samples, clock, questions
    publisher.close()


def test_settings_keep_to_this_machine_unless_asked():
    here = settings("")
    assert "ResolveScope = machine" in here
    assert "AddressesOverride = {127.0.0.1}" in here
    assert "KnownPeers = {127.0.0.1}" in here
    assert "KnownPeers = {127.0.0.1, robot.local}" in settings("robot.local")
    assert "KnownPeers" not in settings("any")
    assert "ResolveScope" not in settings("any")


@pytest.mark.parametrize(
    ("address", "scope", "name"),
    [
        ("demo", "", "demo"),
        ("//any/demo", "any", "demo"),
        ("//10.0.0.7/my demo", "10.0.0.7", "my demo"),
    ],
)
def test_address_says_how_far_to_look(address, scope, name):
    assert split_scope(address) == (scope, name)


@pytest.mark.parametrize("address", ["", "//any", "//any/", "///demo", "a'b", 'a"b', "a\nb", "a<b"])
def test_what_is_no_stream_is_refused(address):
    with pytest.raises(InvalidArrayError, match="is not an LSL stream; expected NAME, //any/NAME"):
        split_scope(address)
    with pytest.raises(InvalidArrayError, match="'x}y' is not a host"):
        split_scope("//x}y/demo")


def test_settings_are_read_once_in_a_process(lsl):
    with pytest.raises(InvalidArrayError, match="uses streams of the kind lsl:NAME already"):
        load_lsl("any")


def test_opening_lsl_to_the_network_is_warned_of(monkeypatch, lsl):
    given = []
    monkeypatch.setattr(lsl_stream, "_scope", [])
    monkeypatch.setattr(lsl, "set_config_content", given.append)
    # As if it had never been loaded; an import gives back the same module.
    monkeypatch.setattr(lsl_stream, "_is_loaded", lambda: False)
    with pytest.warns(SkinWarning, match="LSL is open to"):
        load_lsl("any")
    assert given == [settings("any")]


def test_own_settings_of_the_user_win(monkeypatch, lsl, tmp_path):
    own = tmp_path / "lsl_api.cfg"
    own.write_text("[lab]\nSessionID = mine\n")
    monkeypatch.setenv("LSLAPICFG", str(own))
    monkeypatch.setattr(lsl_stream, "_scope", [])
    with pytest.warns(SkinWarning, match=r"LSL follows .*lsl_api\.cfg \(LSLAPICFG\)"):
        load_lsl("")


class Element:
    """A description as pylsl gives it, of nested lists: (name, text or children)."""

    def __init__(self, children=None, later=()) -> None:
        self.children, self.later = children, later

    def empty(self) -> bool:
        return self.children is None

    def _first(self, name: str, among) -> Element:
        for place, (one, inner) in enumerate(among):
            if one == name:
                return Element(inner, among[place + 1 :])
        return Element()

    def child(self, name: str) -> Element:
        return self._first(name, self.children if isinstance(self.children, list) else [])

    def next_sibling(self, name: str) -> Element:
        return self._first(name, self.later)

    def child_value(self, name: str) -> str:
        found = self.child(name).children
        return found if isinstance(found, str) else ""


class Described:
    def __init__(self, channels: int, rate: float, description) -> None:
        self.name, self.channel_count = (lambda: "fuzzed"), (lambda: channels)
        self.nominal_srate, self.desc = (lambda: rate), (lambda: Element(description))


texts = st.sampled_from(["1", "2", "raw", "pressure", "arm", "-1", "1e3", "", "²", "9" * 30, "a\n"])
names = st.sampled_from(["version", "kind", "robot", "parts", "part", "name", "channels"])
elements = st.recursive(
    st.tuples(names, texts),
    lambda inner: st.tuples(names, st.lists(inner, max_size=4)),
    max_leaves=8,
)
part = st.tuples(st.just("part"), st.lists(elements, max_size=4))
whole = st.lists(part, max_size=3).map(
    lambda parts: [("version", "1"), ("kind", "raw"), ("parts", parts)]
)


@pytest.mark.fuzz
@given(st.integers(-1, 4), st.floats(), st.lists(elements, max_size=5) | whole)
def test_any_description_is_read_or_refused(channels, rate, skin):
    try:
        info = read_description(Described(channels, rate, [("skinmap", skin)]))
    except MessageError:
        return
    assert info.channels == channels
