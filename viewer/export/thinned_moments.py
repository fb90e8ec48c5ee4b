"""A short list of moments out of many, evenly spread over all that passed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from skinmap.live.moment import Moment

MOST = 80  # moments that a file keeps: 8 s at 10 a second, some hundred kilobytes
EVERY = 0.1  # between two of them at first [s]


class Excerpt:
    """Keeps some of the moments that pass; each time it is full, every second is forgotten.

    Attributes
    ----------
    moments : list of Moment
    gap : float
        Time between two of them [s].
    """

    def __init__(self, most: int = MOST) -> None:
        self.moments: list[Moment] = []
        self.gap = EVERY
        self._most = most

    def watch(self, moments: Iterable[Moment]) -> Iterator[Moment]:
        """The same moments, looked at as they pass."""
        for moment in moments:
            self.add(moment)
            yield moment

    def add(self, moment: Moment) -> None:
        """Keep a moment if the last one kept is long enough ago."""
        if self.moments and moment.time < self.moments[-1].time + self.gap - 1e-6:
            return
        self.moments.append(moment)
        if len(self.moments) > self._most:
            self.moments = self.moments[::2]
            self.gap *= 2

    def around(self, chosen: Moment | None) -> tuple[list[Moment], int | None]:
        """What was kept with one more in its place, and which that is; nothing without it."""
        if chosen is None or not self.moments:
            return [], None
        kept = [moment for moment in self.moments if moment.time != chosen.time]
        place = sum(moment.time < chosen.time for moment in kept)
        return [*kept[:place], chosen, *kept[place:]], place
