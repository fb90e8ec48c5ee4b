"""The examination of recordings: every family of faults, one list by harm, a mended copy."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.rows import column, row
from skinmap.soundness.channel_faults import channel_faults, episodes
from skinmap.soundness.finding import HARM, Finding, Span
from skinmap.soundness.place_faults import place_faults
from skinmap.soundness.rest_faults import rest_faults, session_offsets
from skinmap.soundness.set_faults import set_faults, together
from skinmap.soundness.survey import Survey, survey
from skinmap.soundness.time_faults import clock_faults, time_faults
from skinmap.soundness.track import UNSURE, Track, check_track, tracks, tracks_of

if TYPE_CHECKING:
    from skinmap.touch.recording import Recording

# Faults for which a model learns something else than touches, whatever it is trained on.
FALSIFYING = ("duplicate", "order", "restart", "sign", "copied")


@row
class ExaminedFile:
    """Findings in one recording."""

    file: str = column("Path of the recording.")
    rows: int = column("Total number of samples.")
    channels: int = column("Values in a sample.")
    rate_hz: float | None = column("Samples a second; null without times.")
    findings: list[Finding] = column("Its faults, the most harmful first.", heading="")


@row
class Examined:
    """The examination of one or several recordings."""

    files: list[ExaminedFile] = column("One entry for each recording.", heading="")
    findings: list[Finding] = column("Faults of several recordings together.", heading="")
    sound: bool = column("Whether no finding matters.")


def examine(recording: Recording | list[Recording] | str | Path) -> list[Finding]:
    """Find the faults of a recording.

    Parameters
    ----------
    recording : Recording, list of Recording, or path
        One recording, the parts of one, or a file of any format that `skinmap examine` reads, or
        a folder of some: findings of several together are among them.

    Returns
    -------
    list of Finding
        The most harmful first; empty for a sound recording.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or nothing in it to examine.

    Examples
    --------
    >>> import numpy as np, skinmap
    >>> noise = np.random.default_rng(0).normal(size=(500, 12))
    >>> noise[:, 3] = 0.0
    >>> np.savez("noise.npz", samples=noise, times=np.arange(500) / 50)
    >>> [(one.kind, one.channels) for one in skinmap.examine("noise.npz")]
    [('dead', [3])]
    """
    if isinstance(recording, str | Path):
        found = tracks([Path(recording)])
    else:
        found = (check_track(one) for one in tracks_of(recording))
    result = examine_tracks(found)[0]
    return in_order([*result.findings, *(one for file in result.files for one in file.findings)])


def examine_track(track: Track) -> tuple[ExaminedFile, Survey]:
    """Examine one table of channels."""
    with np.errstate(all="ignore"):
        looked = survey(track)
        times = time_faults(looked)
        found = [*times.findings, *clock_faults(looked, times.step)]
        own, bad = channel_faults(looked)
        found += [*own, *(session_offsets(looked, bad) or rest_faults(looked, bad))]
        found += set_faults(looked, bad) + place_faults(looked, bad, episodes(looked))
    rate = 1.0 / times.step if times.step > 0 else None
    named = [
        replace(_marked(one, track), file=track.file, seconds=_seconds(one.rows, track.times))
        for one in in_order(found)
    ]
    count, width = track.values.shape
    return ExaminedFile(
        file=track.file, rows=count, channels=width, rate_hz=rate, findings=named
    ), looked


def _seconds(rows: list[Span] | None, times: FloatArray | None) -> list[list[float]] | None:
    """First and last time of stretches of rows."""
    if rows is None or times is None:
        return None
    return [[float(times[a]), float(times[b])] for a, b in rows]


def _marked(found: Finding, track: Track) -> Finding:
    """A fault that a mended copy holds as a mark does no harm any more."""
    for mark in track.marks:
        own, rows = mark["channels"], mark["rows"]
        covers = own is None or (found.channels is not None and set(found.channels) <= set(own))
        same = rows is None or (
            found.rows is not None
            and all(any(a <= d and c <= b for a, b in rows) for c, d in found.rows)
        )
        if mark["kind"] == found.kind and covers and same:
            return replace(found, matters=False, text=f"{found.text} It is marked.")
    return found


def in_order(found: Iterable[Finding]) -> list[Finding]:
    """The most harmful and surest first."""
    return sorted(found, key=lambda one: (-one.harm, -one.confidence, one.kind))


def examine_tracks(tracks: Iterable[Track]) -> tuple[Examined, list[Survey]]:
    """Examine several recordings, each alone and all together."""
    files, surveys = [], []
    for track in tracks:
        one, looked = examine_track(track)
        files.append(one)
        surveys.append(looked)
    found = in_order(together(surveys)) if len(surveys) > 1 else []
    several = [*found, *(one for file in files for one in file.findings)]
    return Examined(files=files, findings=found, sound=not any(x.matters for x in several)), surveys


def falsifying(tracks: Iterable[Track]) -> Iterator[str]:
    """In a line each the findings for which a figure of a classifier would be wrong.

    Leaks are not among them: training and evaluation have controls of their own.
    """
    surveys = []
    for track in tracks:
        looked = survey(track)
        surveys.append(looked)
        repeated = [one for one in time_faults(looked).findings if one.kind == "duplicate"]
        yield from (f"{track.file}: {one.text}" for one in repeated)
    if len(surveys) > 1:
        yield from (one.text for one in together(surveys) if one.kind == "repeated_recording")


def mend(track: Track) -> tuple[Track, list[str]]:
    """A mended copy of a recording, and what was done to it.

    Rows are put into order, repeated ones are left out, a clock that begins anew becomes a stretch
    of its own, and a reference is laid on the rows of the skin. All other faults become marks.
    """
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
        unit=track.unit if track.unit == UNSURE else "",
        events=None if track.events is None else track.events[rows],
        stretches=None if stretches is None else stretches[rows],
    )
    if track.unit and track.unit != UNSURE:
        done.append(f"wrote the times, which were in {track.unit}, in seconds")
    # A line through repeated rows, or rows in another order, is none through those of the copy.
    clocks = clock_faults(survey(mended), times.step)
    offset, slope = (clocks[0].offset_rows, clocks[0].slope) if clocks else (None, None)
    if track.reference is not None and isinstance(slope, float) and isinstance(offset, float):
        at = (np.arange(len(rows)) - offset) / (1.0 + slope)
        old = np.arange(len(track.reference))
        laid = np.interp(at, old, track.reference, left=np.nan, right=np.nan)
        mended = replace(mended, reference=laid, reference_times=None)
        done.append("laid the reference on the rows of the skin")
    left = examine_track(mended)[0].findings
    marks = tuple(
        {"kind": one.kind, "channels": one.channels, "rows": one.rows, "text": one.text}
        for one in left
        if HARM[one.kind].get("mark")
    )
    done += [f"marked: {one['text']}" for one in marks]
    return replace(mended, marks=marks), done


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
    if track.robot and "," not in track.part:  # the readers of touches take one part of an NPZ
        held |= {"robot": np.array(track.robot), "part": np.array(track.part)}
    held["marks"] = np.array([json.dumps(one) for one in track.marks] or [""])[: len(track.marks)]
    return held
