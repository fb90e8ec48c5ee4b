"""The Corpus of Social Touch: 14 gestures of 31 people on a sensor of 8 x 8 channels.

M. M. Jung, R. Poppe, M. Poel, D. K. J. Heylen, "Touching the Void - Introducing CoST: Corpus of
Social Touch", ICMI 2014. The file is not ours to ship: users bring it (4TU.ResearchData,
doi 10.4121/uuid:5ef62345-3b3e-479c-8e1d-c922748c9b29).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from skinmap.arrays import IntArray
from skinmap.errors import DataFormatError
from skinmap.io.recordings.channel_table import MAX_BYTES
from skinmap.io.text import check_file
from skinmap.skin.skin import Skin, skin_from_points
from skinmap.touch.recording import Recording

SIDE = 8  # channels along each side of the sensor
PITCH = 0.02  # [m]; the sensor is a fabric of 160 x 160 mm
RATE = 135.0  # frames a second
FULL = 1023.0  # of ten bits
PART = "cost_sensor"
# In the alphabetical order in which the corpus counts them from 1.
GESTURES = (
    "grab", "hit", "massage", "pat", "pinch", "poke", "press", "rub", "scratch", "slap", "squeeze",
    "stroke", "tap", "tickle",
)  # fmt: skip
VARIANTS = ("gentle", "normal", "rough")
OWN = ("gesture", "variant", "subject", "frame")


def cost_skin() -> Skin:
    """The sensor, laid flat: it was wrapped around the arm of a mannequin."""
    column, row = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    positions = np.stack([column.ravel(), row.ravel(), np.zeros(SIDE**2)], axis=1) * PITCH
    return skin_from_points(positions, np.tile([0.0, 0.0, 1.0], (SIDE**2, 1)), part=PART)


def read_cost(path: Path) -> list[Recording]:
    """Read the corpus, or a piece of it: a header, then a frame a line.

    The columns are gesture, variant, subject and frame in any order, and 64 channels row by row.
    Gestures and variants are numbers from 1, or words. A capture ends where frames begin anew or
    gesture, variant or subject change. Sessions are the variants, people the subjects.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, other columns, or values that are none.
    """
    check_file(path, "the Corpus of Social Touch (CoST.csv)", MAX_BYTES)
    with path.open(encoding="utf-8", errors="replace") as file:
        names = [cell.strip().strip('"').lower() for cell in file.readline().split(",")]
    missing = [name for name in OWN if name not in names]
    if missing or len(names) != len(OWN) + SIDE**2:
        raise DataFormatError(
            f"not CoST: {len(names)} columns, without {', '.join(missing) or 'its 64 channels'}; "
            f"expected {', '.join(OWN)} and {SIDE**2} channels",
            path,
            1,
        )
    words = {name: names.index(name) for name in OWN}
    converters: dict[int | str, Callable[[str], float]] = {
        words["gesture"]: lambda cell: _number(cell, GESTURES),
        words["variant"]: lambda cell: _number(cell, VARIANTS),
    }
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # nothing after the header: said below
            table = np.loadtxt(
                path, delimiter=",", skiprows=1, ndmin=2, converters=converters, encoding="utf-8"
            )
    except ValueError as error:
        raise DataFormatError(f"not CoST: {error}", path) from None
    if len(table) == 0 or table.shape[1] != len(names):
        raise DataFormatError("no frames of as many values as there are columns", path)
    return [_recording(table, words, path)]


def _number(cell: str, kinds: tuple[str, ...]) -> float:
    word = cell.strip().strip('"').lower()
    return float(kinds.index(word) + 1) if word in kinds else float(word)


def _recording(table: np.ndarray, words: dict[str, int], path: Path) -> Recording:
    said = {name: table[:, column] for name, column in words.items()}
    channels = [k for k in range(table.shape[1]) if k not in words.values()]
    values = table[:, channels]
    whole = [("gesture", len(GESTURES)), ("variant", len(VARIANTS)), ("subject", 10_000)]
    for name, most in whole:
        strange = (said[name] != np.round(said[name])) | (said[name] < 1) | (said[name] > most)
        if strange.any():
            row = int(np.flatnonzero(strange)[0])
            raise DataFormatError(
                f"{name} {said[name][row]:g}, expected 1 to {most}", path, row + 2
            )
    if not ((values >= 0) & (values <= FULL)).all():  # NaN too
        row = int(np.flatnonzero(~((values >= 0) & (values <= FULL)).all(axis=1))[0])
        raise DataFormatError(f"values beyond 0 to {FULL:g}", path, row + 2)
    changes = np.any([np.diff(said[name]) != 0 for name, _ in whole], axis=0)
    changes |= np.diff(said["frame"]) != 1
    events: IntArray = np.concatenate([[0], np.cumsum(changes)])
    first = np.searchsorted(events, np.arange(events[-1] + 1))
    gesture, variant, subject = (said[name][first].astype(int) for name, _ in whole)
    return Recording(
        PART,
        np.arange(len(table)) / RATE,
        np.rint(values * (255.0 / FULL)).astype(np.uint8),
        events,
        tuple(GESTURES[k - 1] for k in gesture),
        subject,
        sessions=tuple(VARIANTS[k - 1] for k in variant),
        people=tuple(f"subject {k}" for k in subject),
    )
