"""When what was touched: the spans that stand on the time slider, in window and page."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from skinmap.live.moment import Moment
from viewer.colours import class_colour

MAX_SPANS = 1000  # remembered; the oldest are forgotten first


@dataclass(frozen=True, slots=True)
class Span:
    """One touch from its first sample to the last that was seen [s], in the moments' clock."""

    part: str
    label: str
    began: float
    ended: float

    def to_json(self, origin: float) -> list[Any]:
        """Beginning and end from the origin [s], colour and words."""
        words = f"{self.label} on {self.part}".replace("_", " ")
        began, ended = round(self.began - origin, 3), round(self.ended - origin, 3)
        return [began, ended, class_colour(self.label), words]


class Timeline:
    """Spans of all touches that passed, however often a recording is led through them.

    Attributes
    ----------
    version : int
        Changes with each span that begins or gets another name.
    """

    def __init__(self) -> None:
        self.version = 0
        self._spans: list[Span] = []
        self._open: dict[tuple[str, int], int] = {}  # place of a touch's span in the list

    @classmethod
    def of(cls, moments: Iterable[Moment]) -> Timeline:
        """That of some moments."""
        made = cls()
        for moment in moments:
            made.see(moment)
        return made

    def see(self, moment: Moment) -> None:
        """Take a moment in."""
        now: dict[tuple[str, int], int] = {}
        for touch in moment.touches:
            key = (touch.part, touch.identity)
            place = self._open.get(key)
            if place is None:
                place = self._place(touch.part, moment.time)
                if place is None:
                    place = len(self._spans)
                    self._spans.append(Span(touch.part, touch.label, moment.time, moment.time))
                    self.version += 1
            span = self._spans[place]
            self.version += span.label != touch.label
            ended = max(span.ended, moment.time)
            self._spans[place] = replace(span, label=touch.label, ended=ended)
            now[key] = place
        self.version += len(self._open.keys() - now.keys())
        self._open = now
        if (over := len(self._spans) - MAX_SPANS) > 0:
            del self._spans[:over]
            self._open = {key: at - over for key, at in now.items() if at >= over}

    def _place(self, part: str, time: float) -> int | None:
        """The span that a touch was in when its time was played before."""
        taken = set(self._open.values())
        for place, span in enumerate(self._spans):
            if span.part == part and span.began <= time <= span.ended and place not in taken:
                return place
        return None

    def spans(self) -> tuple[Span, ...]:
        """All of them, in the order in which they came."""
        return tuple(self._spans)
