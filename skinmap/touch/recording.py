"""Recordings: pressures over time, with the touch event and label of each sample.

What a label may be is checked here, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinmap.archive import headed, open_headed
from skinmap.arrays import FloatArray, IntArray, check_finite, check_whole, freeze
from skinmap.errors import InvalidArrayError, MissingFileError
from skinmap.summary import Summary, listed
from skinmap.touch.contacts.rest import Rest, find_rest

FORMAT = "skinmap-recording-1"


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Recording(Summary):
    """Samples of one part.

    Attributes
    ----------
    part : str
    times : (t,) float
        [s], not decreasing.
    pressures : (t, n_taxels) uint8
        0 at rest, 255 at most.
    events : (t,) int
        Touch event of each sample; -1 between touches.
    labels : tuple of str
        Gesture of each event, in the order of their numbers; "poke+ball" for two at once.
    subjects : (n_events,) int
        Who touched; all 0 where nobody said.
    owners : (n_events, n_taxels) int, optional
        Which of the touches that an event's label joins each taxel belongs to, 0 first; -1 for
        none. Only where touches overlap in time.
    forces : (t,) float, optional
        True contact force [N] of each sample, where a physics engine knows it.
    places : (t, 3) float, optional
        Where that force acts, in the frame of the link [m]; NaN where nothing touches.
    motions : tuple of TrueMotion or None
        The true way, presses and speed of each event that goes on in time, where that is known;
        empty where no event has one.
    robot : str
        What `skinmap.load_robot` loads the robot by; empty where the file does not say.
    sessions, people : (n_events,) tuple of str
        When each touch was recorded, and by whom; empty words where nobody said.
    fingerprint : str
        Of the skin that was recorded (`skinmap.skin.skin`); empty where the file does not
        say.

    Examples
    --------
    >>> import skinmap
    >>> skin = skinmap.load_robot("kaspar").skin("left_hand")
    >>> round(skinmap.simulate(skin, per_gesture=1, gestures=["poke"], rng=0).rate, 6)
    50.0
    """

    part: str
    times: FloatArray
    pressures: NDArray[np.uint8]
    events: IntArray
    labels: tuple[str, ...]
    subjects: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    owners: IntArray | None = None
    forces: FloatArray | None = None
    places: FloatArray | None = None
    robot: str = ""
    sessions: tuple[str, ...] = ()
    people: tuple[str, ...] = ()
    fingerprint: str = ""
    motions: tuple[TrueMotion | None, ...] = ()

    def __post_init__(self) -> None:
        pressures = np.asarray(self.pressures)
        if pressures.dtype != np.uint8 or pressures.ndim != 2:
            raise InvalidArrayError(
                f"pressures must be uint8 of shape (t, n), got {pressures.dtype} {pressures.shape}"
            )
        times = check_finite(self.times, "times", (len(pressures),))
        events = check_whole(self.events, "events", (len(pressures),))
        if len(events) and not -1 <= events.min() <= events.max() < len(self.labels):
            raise InvalidArrayError(f"events must lie in -1..{len(self.labels) - 1}")
        if (np.diff(times) < 0).any():
            raise InvalidArrayError("times must not run backwards")
        subjects = self.subjects if np.size(self.subjects) else np.zeros(len(self.labels), np.int64)
        subjects = check_whole(subjects, "subjects", (len(self.labels),))
        freeze(self, times=times, pressures=pressures, events=events, subjects=subjects)
        for name in ("sessions", "people"):
            words = tuple(getattr(self, name)) or ("",) * len(self.labels)
            if len(words) != len(self.labels):
                raise InvalidArrayError(f"{len(words)} {name} for {len(self.labels)} touch events")
            object.__setattr__(self, name, words)
        if self.owners is not None:
            wanted = (len(self.labels), pressures.shape[1])
            freeze(self, owners=check_whole(self.owners, "owners", wanted))
        if self.forces is not None:
            freeze(self, forces=check_finite(self.forces, "forces", (len(times),)))
        if self.places is not None:
            places = np.asarray(self.places, np.float64)
            if places.shape != (len(times), 3):
                raise InvalidArrayError(
                    f"places must have shape ({len(times)}, 3), got {places.shape}"
                )
            freeze(self, places=places)
        if self.motions and len(self.motions) != len(self.labels):
            raise InvalidArrayError(
                f"motions must be {len(self.labels)}, one an event, got {len(self.motions)}"
            )

    @property
    def rate(self) -> float:
        """Samples a second; 50 where the times do not tell."""
        step = float(np.median(np.diff(self.times))) if len(self.times) > 1 else 0.0
        return 1.0 / step if step > 0 else 50.0

    def rest(self) -> Rest:
        """What its taxels read between the touches; the usual where that is hardly recorded."""
        return find_rest(self.pressures, quiet=self.events < 0)

    def rows(self) -> list[IntArray]:
        """Rows (k,) of the samples of each touch event."""
        return rows_of(self.events, len(self.labels))

    def touches(self) -> Iterator[tuple[int, str, NDArray[np.uint8]]]:
        """Number, label and samples (k, n_taxels) of each touch event."""
        for event, (label, rows) in enumerate(zip(self.labels, self.rows(), strict=True)):
            yield event, label, self.pressures[rows]

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        length = float(self.times[-1] - self.times[0]) if len(self.times) else 0.0
        return {
            "part": self.part,
            "taxels": self.pressures.shape[1],
            "samples": len(self.times),
            "seconds": f"{length:.1f}",
            "touches": len(self.labels),
            "labels": listed(sorted(set(self.labels))),
        }


def rows_of(events: IntArray, count: int) -> list[IntArray]:
    """Rows (k,) of each of `count` touch events among samples (t,), found in one pass."""
    order = np.argsort(events, kind="stable")
    bounds = np.searchsorted(events[order], np.arange(count + 1))
    return [order[first:end] for first, end in pairwise(bounds.tolist())]


ARRAYS = ("times", "pressures", "events", "subjects", "owners", "forces", "places")
NEEDED = ARRAYS[:3]  # in files of the first release, too


def save_recordings(recordings: list[Recording], path: Path) -> None:
    """Write recordings of several parts into one file (a zip of arrays and JSON)."""
    words = ("part", "labels", "robot", "sessions", "people", "fingerprint")
    entries = [{name: getattr(one, name) for name in words} for one in recordings]
    arrays: dict[str, Any] = {}
    for number, recording in enumerate(recordings):
        for name in ARRAYS:
            array = getattr(recording, name)
            if array is not None:
                small = array.astype(np.int8) if name == "owners" else array
                arrays[f"{name}_{number}"] = small
        for event, motion in enumerate(recording.motions):
            if motion is not None:
                for name, array in motion.to_arrays().items():
                    arrays[f"{name}_{number}_{event}"] = array
    path.write_bytes(headed({"format": FORMAT, "recordings": entries}, arrays))


def load_recordings(path: Path) -> list[Recording]:
    """Read what `save_recordings` wrote.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or not a Skinmap recording.
    """
    if not path.is_file():
        raise MissingFileError(path, "a recording made by `skinmap simulate`")
    with open_headed(path, FORMAT, "a Skinmap recording") as (head, arrays):
        return [_recording(arrays, *entry) for entry in enumerate(head["recordings"])]


def _recording(arrays: Mapping[str, Any], number: int, entry: Mapping[str, Any]) -> Recording:
    keys = {name: f"{name}_{number}" for name in ARRAYS}
    return Recording(
        str(entry["part"]),
        labels=tuple(map(str, entry["labels"])),
        robot=str(entry.get("robot", "")),
        sessions=tuple(map(str, entry.get("sessions", ()))),
        people=tuple(map(str, entry.get("people", ()))),
        fingerprint=str(entry.get("fingerprint", "")),
        motions=_motions(arrays, number, len(entry["labels"])),
        **{name: arrays[key] for name, key in keys.items() if name in NEEDED or key in arrays},
    )


def _motions(arrays: Mapping[str, Any], number: int, events: int) -> tuple[TrueMotion | None, ...]:
    """Of each event of a recording; none where no event has one."""
    names = ("presses", "way", "turned")
    found = tuple(
        TrueMotion.from_arrays({name: arrays[f"{name}_{number}_{event}"] for name in names})
        if f"way_{number}_{event}" in arrays
        else None
        for event in range(events)
    )
    return found if any(one is not None for one in found) else ()


# What is known of a simulated touch that goes on in time: its way, its beats and its speed.

NOTHING = np.zeros((0, 3))


@dataclass(frozen=True, eq=False, slots=True)
class TrueMotion:
    """The truth of one touch in time.

    Attributes
    ----------
    onsets, ends : (k,) float
        When each press begins and ends [s]: one of a stroke, several of a double pat.
    times : (p,) float
        Of the places [s]; none where the touch stays.
    places : (p, 3) float
        Where the middle of the hand was on the skin, or beyond its rim, in the link's frame [m].
    turned : float
        How far it was twisted [rad].
    """

    onsets: FloatArray
    ends: FloatArray
    times: FloatArray
    places: FloatArray
    turned: float = 0.0

    def __post_init__(self) -> None:
        onsets = check_finite(self.onsets, "onsets", (None,))
        times = check_finite(self.times, "times", (None,))
        ends = check_finite(self.ends, "ends", onsets.shape)
        places = check_finite(self.places, "places", (len(times), 3))
        freeze(self, onsets=onsets, ends=ends, times=times, places=places)

    @property
    def steps(self) -> FloatArray:
        """(p - 1,) lengths between the places [m]."""
        return np.asarray(np.linalg.norm(np.diff(self.places, axis=0), axis=1))

    @property
    def length(self) -> float:
        """Of the way [m]."""
        return float(self.steps.sum())

    @property
    def speed(self) -> float:
        """Median while it moves [m/s]; 0 where it stays."""
        if len(self.times) < 2:
            return 0.0
        speed = self.steps / np.diff(self.times)
        moving = speed[speed > 0.2 * speed.max(initial=0.0)]
        return float(np.median(moving)) if len(moving) else 0.0

    def shifted(self, seconds: float) -> TrueMotion:
        """The same, later."""
        return TrueMotion(
            self.onsets + seconds, self.ends + seconds, self.times + seconds, self.places,
            self.turned,
        )  # fmt: skip

    def to_arrays(self) -> dict[str, FloatArray]:
        """What a recording keeps, by name."""
        return {
            "presses": np.column_stack([self.onsets, self.ends]),
            "way": np.column_stack([self.times, self.places]),
            "turned": np.array([self.turned]),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Any]) -> TrueMotion:
        """Of what `to_arrays` gave."""
        presses = np.asarray(arrays["presses"], np.float64).reshape(-1, 2)
        way = np.asarray(arrays["way"], np.float64).reshape(-1, 4)
        turned = float(np.asarray(arrays["turned"], np.float64).reshape(-1)[0])
        return cls(presses[:, 0], presses[:, 1], way[:, 0], way[:, 1:], turned)


MAX_LENGTH = 64  # characters; a longer name breaks every table
UNNAMED = "touch"  # a touch that nobody has named
# What is said of touches without a name of their own; the loop, the classifiers and their
# rejection say these words.
RESERVED = (UNNAMED, "unknown", "no_contact")
JOIN = "+"  # between the labels of touches that overlap in time


def check_label(label: str) -> str:
    """A name that touches can be trained under, without the blanks around it.

    Raises
    ------
    InvalidArrayError
        An empty one, one with control characters or `+`, one that is too long, or a word that
        classifiers say where they give no name.

    Examples
    --------
    >>> check_label(" poke ")
    'poke'
    """
    if not label.isprintable():
        raise InvalidArrayError(f"a label without control characters is needed, got {label!r}")
    word = label.strip()
    if not word:
        raise InvalidArrayError("a label is empty; name the gesture, poke for one")
    if len(word) > MAX_LENGTH:
        raise InvalidArrayError(
            f"a label has {len(word)} characters, at most {MAX_LENGTH}: {word[:20]!r}..."
        )
    if JOIN in word:
        raise InvalidArrayError(f"{word!r}: '+' joins the labels of touches at once; use another")
    if word in RESERVED:
        raise InvalidArrayError(
            f"{word!r} is the answer of classifiers for a touch without a name; use another"
        )
    return word
