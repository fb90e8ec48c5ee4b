"""A copy of a recording with all that can be mended surely; other faults stay as marks."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.soundness.examination import examine_track
from skinmap.soundness.finding import Finding
from skinmap.soundness.survey import survey
from skinmap.soundness.time_faults import time_faults
from skinmap.soundness.track import Track

# A leak, a wrong label, a swapped cable or a second use stays a fault: no mark takes it away.
MARKED = (
    "lost", "burst", "stamps", "dead", "stuck", "noisy", "clipped", "quantised", "repeated_id",
    "copied", "sign", "module", "thermal", "drift", "rest", "place",
)  # fmt: skip


def mend(track: Track) -> tuple[Track, list[str]]:
    """A mended copy of a recording, and what was done to it.

    Rows are put into order, repeated ones are left out, a clock that begins anew becomes a stretch
    of its own, and a reference is laid on the rows of the skin. All other faults become marks.
    """
    found = examine_track(track)[0].findings
    times = time_faults(survey(track))
    done: list[str] = []
    several = [own[~times.repeated[own]] for own in times.pieces]
    if track.times is not None:
        several = [own[np.argsort(track.times[own], kind="stable")] for own in several]
    several = [own for own in several if len(own)]
    rows = np.concatenate(several)
    if times.repeated.any():
        done.append(f"left {int(times.repeated.sum())} repeated rows out")
    if (np.diff(rows) < 0).any():
        done.append("put the rows into the order of their times")
    stretches = track.stretches
    if len(several) > 1 and stretches is None:
        done.append(f"made {len(several)} stretches, one for each begin of the clock")
        stretches = np.zeros(len(track.values), np.int64)
        for number, own in enumerate(several):
            stretches[own] = number
    mended = replace(
        track,
        values=track.values[rows],
        times=None if track.times is None else track.times[rows],
        unit="",
        events=None if track.events is None else track.events[rows],
        stretches=None if stretches is None else stretches[rows],
    )
    if track.unit:
        done.append(f"wrote the times, which were in {track.unit}, in seconds")
    line = next((one for one in found if one.kind == "clocks" and one.slope is not None), None)
    if line is not None and track.reference is not None and isinstance(line.slope, float):
        mended = replace(mended, reference=_laid(track.reference, line, rows), reference_times=None)
        done.append("laid the reference on the rows of the skin")
    left = examine_track(mended)[0].findings
    marks = tuple(
        {"kind": one.kind, "channels": one.channels, "rows": one.rows, "text": one.text}
        for one in left
        if one.kind in MARKED
    )
    done += [f"marked: {one['text']}" for one in marks]
    return replace(mended, marks=marks), done


def _laid(reference: FloatArray, line: Finding, rows: Any) -> FloatArray:
    """The reference at rows of the skin; NaN where it has none."""
    assert isinstance(line.offset_rows, float)
    assert isinstance(line.slope, float)
    at = (rows - line.offset_rows) / (1.0 + line.slope)
    found = np.interp(at, np.arange(len(reference)), reference)
    return np.where((at < 0) | (at > len(reference) - 1), np.nan, found)


def arrays_of(track: Track, done: list[str]) -> dict[str, Any]:
    """The arrays of a mended copy, as `skinmap examine` reads them again."""
    held: dict[str, Any] = {"samples": track.values, "mended": np.array(done or [""])}
    several = {
        "times": track.times, "channels": track.ids, "events": track.events,
        "file_index": track.stretches, "pressure_pa": track.reference,
        "reference_times": track.reference_times, "positions": track.places,
    }  # fmt: skip
    held |= {name: one for name, one in several.items() if one is not None}
    words = {"labels": track.labels, "sessions": track.sessions, "people": track.people}
    held |= {name: np.array(one) for name, one in words.items() if one}
    held["marks"] = np.array([json.dumps(one) for one in track.marks] or [""])[: len(track.marks)]
    return held
