from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from skinmap import registry
from skinmap.errors import SkinMismatchError, UnknownNameError
from skinmap.live import open_publisher
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from skinmap.live.publishing.publish import Publisher, publishers
from skinmap.live.sources.source import StreamInfo

INFO = StreamInfo("demo", ("arm", "hand"), (3, 2), 50.0)


class Kept(Publisher):
    """Keeps what it would send."""

    def __init__(self, topics=("raw", "pressure", "contacts", "labels")) -> None:
        super().__init__(INFO, topics)
        self.out: list[tuple] = []

    def _send_samples(self, topic, times, values) -> None:
        self.out.append((topic, times.tolist(), values.tolist(), values.dtype))

    def _send_text(self, topic, time, text) -> None:
        self.out.append((topic, time, json.loads(text)))

    def close(self) -> None:
        pass


def touch(**how) -> NamedTouch:
    how = {"part": "arm", "taxels": np.array([0, 2]), "centre": np.array([0.1, 0.2, 0.3]), **how}
    return NamedTouch(**{"label": "poke", "confidence": 0.75, **how})


def moment(*touches: NamedTouch, time: float = 2.5, **how) -> Moment:
    pressures = {"hand": np.uint8([4, 5]), "arm": np.uint8([1, 2, 3]), "leg": np.uint8([9])}
    return Moment(time, pressures, touches, **how)


def test_publisher_joins_parts_in_the_streams_order():
    kept = Kept(("pressure",))
    kept.send(moment())
    assert kept.out == [("pressure", [2.5], [[1, 2, 3, 4, 5]], np.uint8)]
    assert kept.sent == 1


def test_publisher_sends_raw_values_where_there_are_any():
    kept = Kept(("raw",))
    kept.send(moment())
    assert kept.out == []
    kept.send(moment(raw={"arm": np.ones(3), "hand": np.zeros(2)}))
    assert kept.out[0][:3] == ("raw", [2.5], [[1.0, 1.0, 1.0, 0.0, 0.0]])


def test_publisher_sends_contacts_until_they_are_over():
    kept = Kept(("contacts",))
    normal = np.array([0.0, 0.0, 1.0])
    path = np.array([[0.1, 0.2, 0.3]])
    one = touch(identity=4, began=2.0, normal=normal, area=1e-4, peak=200.0, mean=90.5, path=path)
    for each in (moment(), moment(one), moment(one, time=2.6), moment(time=2.7), moment()):
        kept.send(each)
    assert [(out[1], len(out[2]["contacts"])) for out in kept.out] == [(2.5, 1), (2.6, 1), (2.7, 0)]
    assert kept.out[0][2] == {
        "skinmap": 1,
        "time_s": 2.5,
        "contacts": [
            {
                "part": "arm",
                "identity": 4,
                "began_s": 2.0,
                "taxels": [0, 2],
                "centre_m": [0.1, 0.2, 0.3],
                "normal": [0.0, 0.0, 1.0],
                "area_m2": 1e-4,
                "area_least_m2": None,
                "peak": 200.0,
                "mean": 90.5,
                "load": None,
                "path_m": [[0.1, 0.2, 0.3]],
            }
        ],
    }


def test_publisher_sends_labels_when_they_change():
    kept = Kept(("labels",))
    for name, confidence in (("poke", 0.7), ("poke", 0.7001), ("ball", 0.7), ("ball", 0.9)):
        kept.send(moment(touch(label=name, confidence=confidence, identity=1, began=1.0)))
    kept.send(moment())
    kept.send(moment())
    sent = [[one["label"] for one in out[2]["labels"]] for out in kept.out]
    assert sent == [["poke"], ["ball"], ["ball"], []]
    assert kept.out[0][2]["labels"] == [
        {
            "part": "arm", "identity": 1, "label": "poke", "confidence": 0.7, "began_s": 1.0,
            "kind": None, "motion": None, "hand": None,
        }
    ]  # fmt: skip


def test_publisher_writes_what_is_unknown_as_null():
    kept = Kept(("contacts", "labels"))
    kept.send(moment(touch(confidence=float("nan"))))
    kept.send(moment(touch(confidence=-float("nan"))))
    assert [out[0] for out in kept.out] == ["contacts", "labels", "contacts"]
    (contact,), (label,) = kept.out[0][2]["contacts"], kept.out[1][2]["labels"]
    assert contact["began_s"] is contact["area_m2"] is contact["normal"] is None
    assert label["confidence"] is None


def test_publisher_does_not_repeat_a_stale_sample():
    kept = Kept()
    kept.send(moment(touch(), stale=True))
    assert kept.out == []


def test_publisher_refuses_another_skin():
    kept = Kept(("pressure",))
    with pytest.raises(SkinMismatchError, match="stream 'demo' misses hand"):
        kept.send(Moment(1.0, {"arm": np.zeros(3)}))
    with pytest.raises(SkinMismatchError, match="6 values in a sample, stream 'demo' has 5"):
        kept.send_samples("pressure", np.zeros(1), np.zeros((1, 6)))


def test_open_publisher_says_what_there_is():
    with pytest.raises(
        UnknownNameError, match="no way to publish 'tcp'; the ways are: lsl:NAME, zmq"
    ):
        open_publisher("tcp:5", INFO)
    with pytest.raises(UnknownNameError, match="no topic 'smell'; the topics are: raw, pressure"):
        open_publisher("zmq:5", INFO, topics=["smell"])


def test_open_publisher_finds_those_of_other_packages(monkeypatch):
    opened = []

    def open_kept(address, info, topics, robot):
        opened.append((address, info.name, topics, robot))
        return Kept(topics)

    point = SimpleNamespace(name="kept", load=lambda: open_kept)
    groups = {"skinmap.publishers": [point]}
    monkeypatch.setattr(registry, "entry_points", lambda group: groups.get(group, []))
    monkeypatch.setattr(publishers, "_plugins", None)
    kept = open_publisher("kept:here:5", INFO)
    assert isinstance(kept, Kept)
    assert opened == [("here:5", "demo", ("pressure", "contacts", "labels"), None)]
    with pytest.raises(UnknownNameError, match=r"zmq:PORT.*kept"):
        open_publisher("carrier-pigeon", INFO)
    monkeypatch.setattr(publishers, "_plugins", None)  # not to be kept for other tests
