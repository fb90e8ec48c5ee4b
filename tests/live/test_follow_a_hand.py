"""The worked example: a robot stops for anything, and follows a hand alone."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

from skinmap.live import Moment, NamedTouch
from skinmap.recognition.answers import Answer, Answers, HandAnswer

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "follow_a_hand.py"


@pytest.fixture(scope="module")
def example():
    return runpy.run_path(str(EXAMPLE))


def touched(*hands):
    kind, motion = Answer("poke", 0.9, ("poke",)), Answer("still", 0.9, ("still",))
    touches = tuple(
        NamedTouch(
            "torso", np.array([1]), np.zeros(3), "poke", 0.9,
            answers=None if hand is None else Answers(kind, motion, HandAnswer(hand, 0.5)),
        )
        for hand in hands
    )  # fmt: skip
    return Moment(0.0, {"torso": np.zeros(480)}, touches, latency=1e-3)


@pytest.mark.parametrize("hands", [("other",), ("unsure",), (None,), ("hand", "other")])
def test_it_stops_and_stays_for_what_is_not_surely_a_hand(example, hands):
    follower = example["Follower"](example["PrintedRobot"]())
    follower.decide(touched(*hands))
    follower.decide(touched(*hands))
    follower.decide(touched())
    assert follower.robot.done == ["stop: torso is touched", "go on"]
    assert follower.stop_ms == [1.0]


def test_it_stops_first_and_then_follows_a_hand(example):
    follower = example["Follower"](example["PrintedRobot"]())
    follower.decide(touched("unsure"))
    follower.decide(touched("hand"))
    said = ["stop: torso is touched", "follow the hand on torso at 0 mm/s"]
    assert follower.robot.done == said
    assert follower.follow_ms == [1.0]


def test_it_stops_where_nothing_is_heard(example):
    follower = example["Follower"](example["PrintedRobot"]())
    follower.decide(Moment(0.0, {"torso": np.zeros(480)}, stale=True))
    assert follower.robot.done == ["stop: nobody knows what is touched"]


def test_it_follows_simulated_hands(example):
    follower = example["follow"]("sim:whole_hand", 4.0, speed=float("inf"))
    assert follower.robot.done[0].startswith("stop")
    assert any(what.startswith("follow") for what in follower.robot.done)
    assert len(follower.stop_ms) >= 1
