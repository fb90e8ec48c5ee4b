"""Touches through time: what all contacts of each add up to, from its first sample to its end."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from skinmap.arrays import BoolArray, FloatArray
from skinmap.live.contacts.contact_motion import Motion, MotionBook
from skinmap.live.contacts.named_touch import UNNAMED, NamedTouch, TouchEvent
from skinmap.live.contacts.sample_contacts import Track
from skinmap.live.robot_skin import JoinedSkin
from skinmap.recognition.classifier import NO_CONTACT, Prediction
from skinmap.recognition.prediction_sets import UNKNOWN
from skinmap.touch.contacts.skin_geometry import POOL_SHARE

EVENTS = 1000  # touches that are over and wait to be taken at most
PAUSE = 0.5  # between two presses of a pat or of taps at most [s]
BEAT = 0.45  # a longer press is none of a pat [s]
TOGETHER = 0.1  # the fingers of a hand that pats land within this time [s]
STUCK = 0.5  # of its taxels: a touch with so many stuck ones was none
SAME_PLACE = 0.04  # where the next press of a pat lands [m]
UNSURE = (UNKNOWN, NO_CONTACT, UNNAMED)
SAME = ("began", "area", "area_least", "peak", "presses", "period", "unfinished")
NOBODY = Prediction(UNNAMED, float("nan"))


@dataclass(eq=False, slots=True)
class Entry:
    """A touch that lasts, see `TouchEvent`; its largest load, and whether it still bears half.

    `felt` are the taxels (n,) of its part that were touched so far; what is `stuck` was no touch.
    """

    identity: int
    part: int
    began: float
    seen: float
    centre: FloatArray
    felt: BoolArray
    area: float = 0.0
    area_least: float = 0.0
    peak: float = 0.0
    length: float = 0.0
    heaviest: float = 0.0
    place: FloatArray | None = None  # centre of its load at its heaviest moment
    pressed: bool = True
    name: Prediction = NOBODY
    said: Prediction | None = None  # by the classifier last
    contacts: set[int] = field(default_factory=set)
    early: tuple[str, float] = ("", float("nan"))
    presses: int = 1
    pressed_at: float = float("nan")  # when the last of them began
    released_at: float = float("nan")  # and when the one before was over
    named_at: float = float("nan")  # since when its name has stood
    stuck: bool = False
    unfinished: bool = False

    @property
    def period(self) -> float:
        """Mean time between its presses [s]; NaN of a single one."""
        count = self.presses - 1
        return (self.pressed_at - self.began) / count if count > 0 else float("nan")


class TouchBook:
    """Adds up the contacts of each touch.

    Parameters
    ----------
    skin : JoinedSkin

    Attributes
    ----------
    ended : deque of TouchEvent
        Touches that are over, oldest first; whoever reads takes them out.
    withdrawn : deque of TouchEvent
        The same of what turned out to be stuck taxels.
    motions : MotionBook
        How each moves.
    paused : dict of int to Entry
        Short presses that are over, and may be the beginning of a pat: the next one at the same
        place goes on with their touch.
    part : callable
        Told of a touch that was over when another one began, and of that one.
    revise : callable
        Gives a touch that is over its last name.
    """

    def __init__(self, skin: JoinedSkin) -> None:
        self.skin = skin
        self.motions = MotionBook(skin)
        self.entries: dict[int, Entry] = {}
        self.paused: dict[int, Entry] = {}
        self.part: Callable[[int, int], object] = lambda number, new: None
        self.revise: Callable[[Entry], Prediction | None] = lambda _: None
        self._now = float("nan")  # of the newest sample [s]
        self.ended: deque[TouchEvent] = deque(maxlen=EVENTS)
        self.withdrawn: deque[TouchEvent] = deque(maxlen=EVENTS)

    def update(
        self,
        tracks: Sequence[Track],
        labels: Mapping[int, Prediction] | None = None,
        swallowed: Mapping[int, int] | None = None,
        *,
        time: float = float("inf"),
        pressures: FloatArray | None = None,
    ) -> None:
        """Take the contacts of the next sample.

        `labels` are those that touches were given now. `swallowed` contacts were part of another
        one from the beginning. Without a `time` [s] no press waits for the next one. By their
        `pressures` (N,) the motion of contacts is followed, once a sample.
        """
        self._now = time if time < float("inf") else self._now
        if not tracks and not self.entries and not self.paused:
            return
        self._resume(tracks)
        self._part_long_ones(tracks)
        alive = {track.touch for track in tracks}
        belongs = {track.identity: track.touch for track in tracks}
        for one, other in (swallowed or {}).items():
            if other in belongs:
                belongs[one] = belongs[other]
        groups = _by_touch(tracks)
        for number, members in groups.items():
            for track in members:
                self._add(track)
            entry, load = self.entries[number], sum(one.load for one in members)
            if load > entry.heaviest:
                entry.heaviest = load
                entry.place = np.sum([one.load * one.centre for one in members], axis=0) / load
            entry.area = max(entry.area, sum(one.area for one in members))
            entry.area_least = max(entry.area_least, sum(one.area_least for one in members))
            entry.pressed = load >= POOL_SHARE * entry.heaviest
        for number, entry in list(self.entries.items()):
            if number in alive:
                entry.said = (labels or {}).get(number, entry.said)
                # What lets go says little: the last finger of a hand is no poke.
                if entry.said is not None and (entry.pressed or entry.name is NOBODY):
                    if entry.name.label != entry.said.label:
                        entry.named_at = entry.seen
                    entry.name = entry.said
                continue
            del self.entries[number]
            heir = {belongs[one] for one in entry.contacts if one in belongs}
            if heir:  # it turned out to be part of another touch
                self._fold(entry, self.entries[min(heir)])
                self.motions.join(number, min(heir))
            elif entry.seen - entry.pressed_at <= BEAT and time - entry.seen <= PAUSE:
                self.paused[number] = entry
            else:
                self._end(entry)
        for number, entry in list(self.paused.items()):
            if not time - entry.seen <= PAUSE:
                del self.paused[number]
                self._end(entry)
        if pressures is not None:
            self.motions.update(time, groups, pressures)

    def forget(self, *, cut: bool = False) -> None:
        """End all touches: the clock began anew, or samples end and may cut some off."""
        for entry in self.entries.values():
            entry.unfinished = cut and entry.seen >= self._now
        self.update([])
        self.motions.forget()

    def withdraw(self, stuck: BoolArray) -> None:
        """Take back the touches that last and consist of taxels (N,) found to be stuck."""
        for entry in (*self.entries.values(), *self.paused.values()):
            hangs = entry.felt & stuck[self.skin.slices[self.skin.parts[entry.part]]]
            entry.stuck |= bool(hangs.sum() >= STUCK * entry.felt.sum())
            if not entry.stuck:
                entry.felt &= ~hangs

    @property
    def lasting(self) -> dict[int, int]:
        """The part of each touch that is not over, those between two presses too."""
        return {number: entry.part for number, entry in {**self.paused, **self.entries}.items()}

    def _resume(self, tracks: Sequence[Track]) -> None:
        """Give new contacts to touches that were pressed shortly before at the same place."""
        for track in tracks:
            if track.touch in self.entries or not len(track.taxels):
                continue
            for number, entry in [*self.paused.items(), *self.entries.items()]:
                begun = entry.presses > 1 and 0.0 <= track.began - entry.pressed_at <= TOGETHER
                if entry.part != track.part or not (number in self.paused or begun):
                    continue
                if float(np.linalg.norm(track.centre - entry.centre)) > SAME_PLACE:
                    continue
                track.touch = number
                if number in self.paused:
                    self.entries[number] = self.paused.pop(number)
                    entry.presses, entry.pressed_at = entry.presses + 1, track.began
                    entry.released_at = entry.seen
                    self.motions.drop(number)  # each press has a way of its own
                break

    def _part_long_ones(self, tracks: Sequence[Track]) -> None:
        """Presses that last are none of a pat: each becomes a touch of its own again.

        Those that they were taken for are over.
        """
        for number, entry in list(self.entries.items()):
            if entry.presses == 1 or not entry.seen - entry.pressed_at > BEAT:
                continue
            own = [one for one in tracks if one.touch == number and len(one.taxels)]
            if not own:
                continue
            new = min(one.identity for one in own)
            if new == number:
                continue
            for one in own:
                one.touch = new
            began, contacts = entry.pressed_at, {one.identity for one in own}
            self.entries[new] = Entry(
                new, entry.part, began, entry.seen, own[0].centre, self._none(entry.part),
                peak=own[0].peak, pressed_at=began, contacts=contacts,
            )  # fmt: skip
            self.motions.join(number, new)
            del self.entries[number]
            entry.contacts -= contacts
            period, entry.presses = entry.period, entry.presses - 1
            entry.seen = entry.released_at
            entry.pressed_at = entry.began + (entry.presses - 1) * period
            self._end(entry)
            self.part(number, new)

    def _end(self, entry: Entry) -> None:
        early, since = entry.name.label, min(entry.named_at, entry.seen) - entry.began
        entry.early = (early, since) if early not in UNSURE else ("", float("nan"))
        # All of a touch that was cut off would pass for a short one: its name so far stays.
        last = None if entry.stuck or entry.unfinished else self.revise(entry)
        if last is not None:
            entry.name = last
        (self.withdrawn if entry.stuck else self.ended).append(self._event(entry))
        self.motions.drop(entry.identity)

    def show(self, tracks: Sequence[Track]) -> tuple[NamedTouch, ...]:
        """The touches that are felt now."""
        shown = []
        for number, members in _by_touch(tracks).items():
            entry = self.entries[number]
            if not entry.stuck:
                motion = self.motions.motion(
                    number, entry.part, members[0].normal, presses=entry.presses,
                    period=entry.period,
                )  # fmt: skip
                shown.append(self._named(members, entry, motion))
        return tuple(shown)

    def _named(self, members: list[Track], entry: Entry, motion: Motion | None) -> NamedTouch:
        """One or several contacts as a touch; the oldest says where it is."""
        lead, name = members[0], entry.name
        start = self.skin.starts[lead.part]
        rows = [one.taxels for one in members]
        taxels = (rows[0] if len(rows) == 1 else np.sort(np.concatenate(rows))) - start
        return NamedTouch(
            self.skin.parts[lead.part],
            taxels,
            lead.centre,
            name.label,
            name.confidence,
            entry.identity,
            entry.began,
            lead.normal,
            sum(one.area for one in members),
            max(one.peak for one in members),
            sum(one.load for one in members) / len(taxels),
            None if lead.stroke is None else lead.stroke.points,
            _answered(motion, name),
            name.answers,
            area_least=sum(one.area_least for one in members),
        )

    def _add(self, track: Track) -> None:
        entry = self.entries.get(track.touch)
        if entry is None:
            entry = self.entries[track.touch] = Entry(
                track.touch, track.part, track.began, track.seen, track.centre,
                self._none(track.part),
            )  # fmt: skip
            entry.pressed_at = track.began
        if track.seen > entry.seen or not entry.contacts:
            entry.centre, entry.seen = track.centre, track.seen
        entry.began = min(entry.began, track.began)
        entry.peak = max(entry.peak, track.peak)
        if track.stroke is not None:
            entry.length = max(entry.length, track.stroke.length)
        entry.contacts.add(track.identity)
        entry.felt[track.taxels - self.skin.starts[track.part]] = True

    def _none(self, part: int) -> BoolArray:
        return np.zeros(len(self.skin.skins[self.skin.parts[part]]), bool)

    @staticmethod
    def _fold(entry: Entry, into: Entry) -> None:
        if entry.presses > into.presses:
            into.presses, into.pressed_at = entry.presses, entry.pressed_at
            into.released_at = entry.released_at
        into.began = min(into.began, entry.began)
        for name in ("area", "area_least", "peak", "length"):
            setattr(into, name, max(getattr(into, name), getattr(entry, name)))
        if entry.heaviest > into.heaviest:
            into.heaviest, into.place = entry.heaviest, entry.place
        into.contacts |= entry.contacts
        into.felt |= entry.felt

    def _event(self, entry: Entry) -> TouchEvent:
        gone, part = self.motions.course(entry.identity), self.skin.parts[entry.part]
        skin = self.skin.skins[part].skin
        return TouchEvent(
            entry.identity,
            part,
            entry.name.label,
            entry.name.confidence,
            ended=entry.seen,
            path_length=entry.length,
            centre=entry.centre if entry.place is None else entry.place,
            contacts=len(entry.contacts),
            names=entry.name.names,
            early=entry.early[0],
            early_after=entry.early[1],
            channels=tuple(skin.channels[entry.felt].tolist()),
            answers=entry.name.answers,
            **{name: getattr(entry, name) for name in SAME},
            **{name: getattr(gone, name) for name in ("heading", "up", "right", "speed")},
        )


def _by_touch(tracks: Sequence[Track]) -> dict[int, list[Track]]:
    """The contacts that are felt, by the number of their touch."""
    groups: dict[int, list[Track]] = {}
    for track in tracks:
        if len(track.taxels):
            groups.setdefault(track.touch, []).append(track)
    return groups


def _answered(motion: Motion | None, name: Prediction) -> Motion | None:
    """A motion with what a model answers how it is."""
    if motion is None or name.answers is None:
        return motion
    said = name.answers.motion
    return replace(motion, answer=said.answer, probability=said.probability, set=said.set)
