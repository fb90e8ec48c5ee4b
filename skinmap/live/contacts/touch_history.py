"""Touches through time: what all contacts of each add up to, from its first sample to its end."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.classify.classifier import Prediction
from skinmap.live.contacts.events import TouchEvent
from skinmap.live.contacts.followed_contact import Track
from skinmap.live.contacts.named_touch import UNNAMED, NamedTouch
from skinmap.live.robot_skin import JoinedSkin
from skinmap.touch.contacts import POOL_SHARE

EVENTS = 1000  # touches that are over and wait to be taken at most
NOBODY = Prediction(UNNAMED, float("nan"))


@dataclass(eq=False, slots=True)
class Entry:
    """A touch that lasts, see `TouchEvent`; its largest load, and whether it still bears half."""

    identity: int
    part: int
    began: float
    seen: float
    centre: FloatArray
    area: float = 0.0
    peak: float = 0.0
    length: float = 0.0
    heaviest: float = 0.0
    pressed: bool = True
    name: Prediction = NOBODY
    contacts: set[int] = field(default_factory=set)


class TouchBook:
    """Adds up the contacts of each touch.

    Parameters
    ----------
    skin : JoinedSkin

    Attributes
    ----------
    ended : deque of TouchEvent
        Touches that are over, oldest first; whoever reads takes them out.
    """

    def __init__(self, skin: JoinedSkin) -> None:
        self.skin = skin
        self.entries: dict[int, Entry] = {}
        self.ended: deque[TouchEvent] = deque(maxlen=EVENTS)

    def update(
        self,
        tracks: Sequence[Track],
        labels: Mapping[int, Prediction] | None = None,
        swallowed: Mapping[int, int] | None = None,
    ) -> list[int]:
        """Take the contacts of the next sample; the numbers of touches that are over now.

        `swallowed` contacts were part of another one from the beginning.
        """
        if not tracks and not self.entries:
            return []
        alive = {track.touch for track in tracks}
        belongs = {track.identity: track.touch for track in tracks}
        for one, other in (swallowed or {}).items():
            if other in belongs:
                belongs[one] = belongs[other]
        sums: dict[int, tuple[float, float]] = {}
        for track in tracks:
            if len(track.taxels):
                self._add(track)
                area, load = sums.get(track.touch, (0.0, 0.0))
                sums[track.touch] = area + track.area, load + track.load
        for number, (area, load) in sums.items():
            entry = self.entries[number]
            entry.area, entry.heaviest = max(entry.area, area), max(entry.heaviest, load)
            entry.pressed = load >= POOL_SHARE * entry.heaviest
        over = []
        for number, entry in list(self.entries.items()):
            if number in alive:
                # What lets go says little: the last finger of a hand is no poke.
                if labels and number in labels and (entry.pressed or entry.name is NOBODY):
                    entry.name = labels[number]
                continue
            over.append(number)
            del self.entries[number]
            heir = {belongs[one] for one in entry.contacts if one in belongs}
            if heir:  # it turned out to be part of another touch
                self._fold(entry, self.entries[min(heir)])
            else:
                self.ended.append(self._event(entry))
        return over

    def show(self, tracks: Sequence[Track]) -> tuple[tuple[NamedTouch, ...], ...]:
        """The touches that are felt now, and their contacts one by one."""
        groups: dict[int, list[Track]] = {}
        for track in tracks:
            if len(track.taxels):
                groups.setdefault(track.touch, []).append(track)
        touches, contacts = [], []
        for number, members in groups.items():
            entry = self.entries[number]
            single = [self._named([one], one.identity, one.began, entry.name) for one in members]
            contacts += single
            if len(members) == 1 and members[0].identity == number:
                touches += single
            else:
                touches.append(self._named(members, number, entry.began, entry.name))
        return tuple(touches), tuple(contacts)

    def _named(
        self, members: list[Track], number: int, began: float, name: Prediction
    ) -> NamedTouch:
        """One or several contacts as a touch; the oldest says where it is."""
        lead = members[0]
        start = self.skin.starts[lead.part]
        rows = [one.taxels for one in members]
        taxels = (rows[0] if len(rows) == 1 else np.sort(np.concatenate(rows))) - start
        force = sum(one.force for one in members)
        return NamedTouch(
            self.skin.parts[lead.part],
            taxels,
            lead.centre,
            name.label,
            name.confidence,
            number,
            began,
            lead.normal,
            sum(one.area for one in members),
            max(one.peak for one in members),
            sum(one.load for one in members) / len(taxels),
            None if force != force else force,  # NaN: nobody knows
            None if lead.stroke is None else lead.stroke.points,
        )

    def _add(self, track: Track) -> None:
        entry = self.entries.get(track.touch)
        if entry is None:
            entry = self.entries[track.touch] = Entry(
                track.touch, track.part, track.began, track.seen, track.centre
            )
        if track.seen > entry.seen or not entry.contacts:
            entry.centre, entry.seen = track.centre, track.seen
        entry.began = min(entry.began, track.began)
        entry.peak = max(entry.peak, track.peak)
        if track.stroke is not None:
            entry.length = max(entry.length, track.stroke.length)
        entry.contacts.add(track.identity)

    @staticmethod
    def _fold(entry: Entry, into: Entry) -> None:
        into.began = min(into.began, entry.began)
        into.area, into.peak = max(into.area, entry.area), max(into.peak, entry.peak)
        into.length = max(into.length, entry.length)
        into.heaviest = max(into.heaviest, entry.heaviest)
        into.contacts |= entry.contacts

    def _event(self, entry: Entry) -> TouchEvent:
        return TouchEvent(
            entry.identity,
            self.skin.parts[entry.part],
            entry.name.label,
            entry.name.confidence,
            entry.began,
            entry.seen,
            entry.area,
            entry.peak,
            entry.length,
            entry.centre,
            len(entry.contacts),
            entry.name.names,
        )
