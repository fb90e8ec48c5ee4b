"""Marks of touches as a list that people edit: name, split, join, delete, and a CSV of it."""

from __future__ import annotations

import csv
import io
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.errors import DataFormatError, InvalidArrayError
from skinmap.io.recordings.recorded_stream import MarkedTouch, RecordedStream, part_events
from skinmap.io.text import csv_rows, in_file, parse_floats, read_text
from skinmap.touch.recording import JOIN, UNNAMED, Recording, check_label

COLUMNS = ("part", "event", "began_s", "ended_s", "label", "session", "person")
MAX_DIGITS = 9  # of the number of a touch
KEYS = (
    "enter next, b back, g N go to touch N, n NAME name, s split (s SECONDS after its beginning), "
    "j join with the next of its part, d delete, u undo"
)
# Of a touch that was split or joined.
UNKNOWN: dict[str, Any] = {"owners": None, "motion": None, "channels": (), "answers": None}
HAIR = 5e-4  # [s], or a quarter of a sample: people write times to the millisecond


@dataclass(frozen=True, slots=True)
class Marks:
    """Touches of a recording in the order of time; each change gives a new list."""

    touches: tuple[MarkedTouch, ...]

    def __post_init__(self) -> None:
        some = [one for one in self.touches if one.first <= one.last]
        order = sorted(some, key=lambda one: (one.first, one.part, one.last))
        object.__setattr__(self, "touches", tuple(order))

    def __len__(self) -> int:
        return len(self.touches)

    def name(self, place: int, label: str) -> Marks:
        """One touch by another name."""
        return self._with(place, replace(self.touches[place], label=check_label(label)))

    def delete(self, place: int) -> Marks:
        """All but one touch."""
        return self._with(place)

    def split(self, place: int, row: int) -> Marks:
        """One touch as two, the second from a row on.

        Raises
        ------
        InvalidArrayError
            A row that is not inside the touch.
        """
        one = self.touches[place]
        if not one.first < row <= one.last:
            raise InvalidArrayError(
                f"a touch of samples {one.first} to {one.last} cannot be split at {row}"
            )
        number = 1 + max(other.event for other in self.touches if other.part == one.part)
        whole = replace(one, **UNKNOWN)
        later = replace(whole, event=number, first=row)
        return self._with(place, replace(whole, last=row - 1), later)

    def join(self, place: int) -> Marks:
        """One touch and the next one of its part as one, by the first one's name.

        Raises
        ------
        InvalidArrayError
            The last touch of its part.
        """
        one = self.touches[place]
        later = [k for k in range(place + 1, len(self)) if self.touches[k].part == one.part]
        if not later:
            raise InvalidArrayError(f"no later touch of {one.part!r} to join with")
        last = max(one.last, self.touches[later[0]].last)
        rest = tuple(t for k, t in enumerate(self.touches) if k not in (place, later[0]))
        return Marks((*rest, replace(one, last=last, **UNKNOWN)))

    def _with(self, place: int, *others: MarkedTouch) -> Marks:
        return Marks((*self.touches[:place], *others, *self.touches[place + 1 :]))


class MarkEditor:
    """A list of touches that is gone through and changed, step by step, with a way back.

    Parameters
    ----------
    marks : Marks
    track : RecordedStream
        What was recorded.

    Attributes
    ----------
    place : int
        The touch that is shown.
    loads : (t,) float
        Sum of all values of each sample.
    """

    def __init__(self, marks: Marks, track: RecordedStream) -> None:
        self._history, self._track, self.place = [marks], track, 0
        self.loads: FloatArray = np.zeros(len(track.times))
        for rows, values in track.blocks():
            self.loads[rows] = values.sum(axis=1, dtype=np.float64)

    @property
    def marks(self) -> Marks:
        """The list as it is now."""
        return self._history[-1]

    def shown(self) -> str:
        """The present touch in a line."""
        if not len(self.marks):
            return "no touch"
        one, times = self.marks.touches[self.place], self._track.times
        return (
            f"{self.place + 1}/{len(self.marks)} {one.part} {times[one.first]:.2f} to "
            f"{times[one.last]:.2f} s ({one.last - one.first + 1} samples) {one.label}"
        )

    def press(self, key: str, rest: str = "") -> None:
        """Do what a key stands for (`KEYS`), with the word or number behind it.

        Raises
        ------
        ValueError
            No such key, nothing to change, or an invalid number.
        InvalidArrayError
            A name, a split or a join that cannot be.
        """
        if key in ("", "b", "g"):
            self.place = int(rest) - 1 if key == "g" else self.place + (-1 if key else 1)
        elif key == "u":
            self._history = self._history[:-1] or self._history
        else:
            if not len(self.marks):
                raise ValueError("no touch to change")
            self._history.append(self._changed(key, rest))
            self.place += key == "n"
        self.place = min(max(self.place, 0), max(len(self.marks) - 1, 0))

    def _changed(self, key: str, rest: str) -> Marks:
        marks, place = self.marks, self.place
        if key == "n":
            return marks.name(place, rest)
        if key == "d":
            return marks.delete(place)
        if key == "j":
            return marks.join(place)
        if key == "s":
            return marks.split(place, self._split_row(rest))
        raise ValueError(f"no key {key!r}; {KEYS}")

    def _split_row(self, rest: str) -> int:
        """So many seconds into the touch, else its least load away from both of its ends."""
        one, times = self.marks.touches[self.place], self._track.times
        if rest:
            return int(np.searchsorted(times, times[one.first] + float(rest) - 1e-9))
        margin = max(1, (one.last - one.first) // 5)
        inside = self.loads[one.first + margin : one.last + 1 - margin]
        return one.first + margin + int(inside.argmin()) if len(inside) else one.last


def marks_csv(marks: Marks, times: FloatArray) -> str:
    """The list as CSV, times [s] to the millisecond."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for one in marks.touches:
        began, ended = (f"{times[row]:.6f}".removesuffix("000") for row in (one.first, one.last))
        writer.writerow([one.part, one.event, began, ended, one.label, one.session, one.person])
    return text.getvalue()


def read_marks(path: Path, before: Marks, times: FloatArray, parts: Sequence[str]) -> Marks:
    """The list that a CSV of `marks_csv` has become.

    Parameters
    ----------
    path : Path
    before : Marks
        What the recording has; owners are kept, and motions of touches whose times stay.
    times : (t,) float
        [s].
    parts : sequence of str
        That were recorded.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, missing columns, and of a line: no number, an unknown part, an end before
        its beginning, no sample, a label that nobody can use, or a touch that overlaps another.
    """
    rows = csv_rows(read_text(path), path)
    _, names = next(rows, (1, []))
    if not {"part", "began_s", "ended_s", "label"} <= set(names):
        raise DataFormatError(f"not a table of touches: columns {', '.join(COLUMNS)}", path, 1)
    known = {(one.part, one.event): one for one in before.touches}
    free = 1 + max((one.event for one in before.touches), default=-1)
    steps = np.diff(times)
    hair = min(HAIR, 0.25 * float(np.median(steps[steps > 0]))) if (steps > 0).any() else HAIR
    found: dict[tuple[str, int], MarkedTouch] = {}  # each with a number of its own
    spans: dict[str, list[tuple[int, int]]] = {}  # of each part, in the order of time
    for line, row in rows:
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(names):
            raise DataFormatError(f"{len(row)} cells for {len(names)} columns", path, line)
        cells = dict(zip(names, (cell.strip() for cell in row), strict=True))
        if cells["part"] not in parts:
            raise DataFormatError(
                f"no part {cells['part']!r}; the parts are: {', '.join(parts)}", path, line
            )
        one = _marked(cells, times, hair, path, line)
        number = cells.get("event", "")
        if len(number) > MAX_DIGITS:
            raise DataFormatError(f"no touch has the number {number[:20]}...", path, line)
        event = int(number) if number.isdecimal() else free
        free = max(free, event) + 1
        old = known.get((one.part, event))
        if old is not None:
            same = (old.first, old.last) == (one.first, one.last)
            one = replace(
                old if same else one,
                label=one.label,
                session=one.session,
                person=one.person,
                owners=old.owners if JOIN in one.label else None,
                subject=old.subject,
            )
        own = spans.setdefault(one.part, [])
        place = bisect_left(own, (one.first, one.last))
        for first, last in own[max(place - 1, 0) : place + 1]:  # those beside it in time
            if first <= one.last and one.first <= last:
                raise DataFormatError(
                    f"overlaps the touch of {one.part!r} from {times[first]:.3f} s on", path, line
                )
        own.insert(place, (one.first, one.last))
        if (one.part, event) in found:
            event, free = free, free + 1
        found[one.part, event] = replace(one, event=event)
    return Marks(tuple(found.values()))


def _marked(
    cells: dict[str, str], times: FloatArray, hair: float, path: Path, line: int
) -> MarkedTouch:
    began, ended = parse_floats([cells["began_s"], cells["ended_s"]], path, line)
    first = int(np.searchsorted(times, began - hair))
    last = int(np.searchsorted(times, ended + hair, side="right")) - 1
    if not first <= last:
        held = f"the recording has those from {times[0]:.13g} to {times[-1]:.13g} s"
        raise DataFormatError(f"no sample from {began:.13g} to {ended:.13g} s; {held}", path, line)
    label = cells["label"]
    if label != UNNAMED:
        with in_file(path, line):
            label = JOIN.join(check_label(word) for word in label.split(JOIN))
    session, person = cells.get("session", ""), cells.get("person", "")
    return MarkedTouch(cells["part"], 0, label, first, last, session=session, person=person)


def remarked(recording: Recording, marks: Marks, path: Path) -> Recording:
    """A recording with other marks."""
    own = [one for one in marks.touches if one.part == recording.part]
    found = part_events(own, len(recording.times), recording.pressures.shape[1], path)
    return replace(recording, **found.known())
