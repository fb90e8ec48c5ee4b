"""Marked touches as an event of each sample, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import IntArray
from skinmap.errors import DataFormatError
from skinmap.io.recordings.recorded_stream import MarkedTouch
from skinmap.touch.recording import Recording
from skinmap.touch.true_motion import TrueMotion


@dataclass(frozen=True, eq=False, slots=True)
class PartEvents:
    """Event of each sample (t,), and of each event what is known of it; see `Recording`."""

    events: IntArray
    labels: tuple[str, ...]
    subjects: IntArray
    owners: IntArray | None
    sessions: tuple[str, ...]
    people: tuple[str, ...]
    motions: tuple[TrueMotion | None, ...]  # empty where none is known


def touches_of(recording: Recording) -> list[MarkedTouch]:
    """Where each event begins and ends; more than once where it was interrupted."""
    events = recording.events
    changes = np.flatnonzero(np.diff(events, prepend=-1, append=-1))
    return [
        MarkedTouch(
            recording.part,
            event,
            recording.labels[event],
            first,
            after - 1,
            int(recording.subjects[event]),
            _owners(recording, event),
            recording.sessions[event],
            recording.people[event],
            recording.motions[event] if recording.motions else None,
        )
        for first, after in zip(changes[:-1].tolist(), changes[1:].tolist(), strict=True)
        if (event := int(events[first])) >= 0
    ]


def _owners(recording: Recording, event: int) -> dict[str, list[int]] | None:
    if recording.owners is None:
        return None
    owners = recording.owners[event]
    return {
        str(one): np.flatnonzero(owners == one).tolist()
        for one in range(int(owners.max(initial=-1)) + 1)
    }


def taxel_columns(
    channels: NDArray[Any] | None, width: int, part: str, path: Path
) -> IntArray | slice:
    """Columns of a part's taxels among its values: all, or their channels in the live vector.

    Raises
    ------
    DataFormatError
        Fewer values than the taxels need.
    """
    if channels is None or len(channels) == width:
        return slice(None)
    if int(np.max(channels, initial=-1)) >= width:
        raise DataFormatError(f"{width} channels of {part!r}, its taxels need more", path)
    return np.asarray(channels, np.int64)


def part_events(touches: Sequence[MarkedTouch], count: int, taxels: int, path: Path) -> PartEvents:
    """Events of the first samples of a part.

    Raises
    ------
    DataFormatError
        Owners that are no taxels.
    """
    numbers = sorted({touch.event for touch in touches if touch.first <= touch.last < count})
    place = {number: row for row, number in enumerate(numbers)}
    events = np.full(count, -1)
    labels, sessions, people = ([""] * len(numbers) for _ in range(3))
    motions: list[TrueMotion | None] = [None] * len(numbers)
    subjects = np.zeros(len(numbers), np.int64)
    joined = any(touch.owners for touch in touches)
    owners = np.full((len(numbers), taxels), -1) if joined else None
    for touch in touches:
        if touch.event not in place or not 0 <= touch.first <= touch.last < count:
            continue
        row = place[touch.event]
        span = events[touch.first : touch.last + 1]
        span[span < 0] = row  # what began first keeps its samples
        labels[row], subjects[row] = touch.label, touch.subject
        sessions[row], people[row], motions[row] = touch.session, touch.person, touch.motion
        if owners is not None:
            owners[row] = _owner_row(touch.owners or {}, taxels, path)
    known = tuple(motions) if any(motions) else ()
    words = tuple(labels), tuple(sessions), tuple(people)
    return PartEvents(events, words[0], subjects, owners, *words[1:], known)


def _owner_row(owners: Mapping[str, list[int]], taxels: int, path: Path) -> IntArray:
    row = np.full(taxels, -1)
    for name, members in owners.items():
        try:
            row[np.asarray(members, np.int64)] = int(name)
        except (ValueError, IndexError, TypeError, OverflowError):
            raise DataFormatError(f"owner {name!r} of a touch is damaged", path) from None
    return row
