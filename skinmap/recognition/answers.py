"""Three answers about a touch, beside the name that was trained: kind, motion and hand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

HandWord = Literal["hand", "other", "unsure"]


@dataclass(frozen=True, slots=True)
class Answer:
    """One of the three answers about a touch.

    Attributes
    ----------
    answer
        Name with the highest probability.
    probability
        Probability of the answer.
    set
        The names that hold the truth in nine of ten touches, the likeliest first; never empty.
    """

    answer: str
    probability: float
    set: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class HandAnswer:
    """Answer to the question whether a hand makes the touch.

    Attributes
    ----------
    answer
        `hand`, `other`, or `unsure` between the two.
    probability
        Probability of a hand.
    """

    answer: HandWord
    probability: float


@dataclass(frozen=True, slots=True)
class Answers:
    """All three.

    Attributes
    ----------
    kind
        With what: a kind of hand's touch, or of thing where it is surely no hand.
    motion
        How it moves: still, tap, pat, stroke, rub, slide, twist or squeeze.
    hand
        Whether it is a hand.
    """

    kind: Answer
    motion: Answer
    hand: HandAnswer


def answers_object(answers: Answers | None) -> dict[str, Any]:
    """Kind, motion and hand as JSON has them; null where no model answers."""
    if answers is None:
        return {"kind": None, "motion": None, "hand": None}
    found: dict[str, Any] = {
        name: {"answer": one.answer, "probability": round(one.probability, 4), "set": list(one.set)}
        for name, one in (("kind", answers.kind), ("motion", answers.motion))
    }
    hand = answers.hand
    return {**found, "hand": {"answer": hand.answer, "probability": round(hand.probability, 4)}}
