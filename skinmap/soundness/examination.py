"""The examination of recordings: every family of faults, and one list in order of harm."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from skinmap.rows import column, row
from skinmap.soundness.channel_faults import channel_faults, episodes
from skinmap.soundness.clock_faults import clock_faults
from skinmap.soundness.finding import Finding
from skinmap.soundness.place_faults import place_faults
from skinmap.soundness.rest_faults import rest_faults, session_offsets
from skinmap.soundness.set_faults import set_faults, together
from skinmap.soundness.survey import Survey, survey
from skinmap.soundness.time_faults import time_faults
from skinmap.soundness.track import Track, check_track, tables_in, tracks_of

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
        One recording, the parts of one, or a file of any format that `skinmap examine` reads.

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
        found = tables_in(Path(recording))
    else:
        found = [check_track(one) for one in tracks_of(recording)]
    return in_order(one for track in found for one in examine_track(track)[0].findings)


def examine_track(track: Track) -> tuple[ExaminedFile, Survey]:
    """Examine one table of channels."""
    with np.errstate(all="ignore"):
        looked = survey(track)
        times = time_faults(looked)
        found = [*times.findings, *clock_faults(looked, times.step)]
        own, bad = channel_faults(looked)
        found += own
        found += session_offsets(looked, bad) or rest_faults(looked, bad)
        found += set_faults(looked, bad) + place_faults(looked, bad, episodes(looked))
    rate = 1.0 / times.step if times.step > 0 else None
    named = [replace(_marked(one, track), file=track.file) for one in in_order(found)]
    count, width = track.values.shape
    return ExaminedFile(
        file=track.file, rows=count, channels=width, rate_hz=rate, findings=named
    ), looked


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
