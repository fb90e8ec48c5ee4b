"""`skinmap examine`: faults of recordings, in order of harm.

Its page has a time line, the channels by their state, and two clocks.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np

from skinmap.commands import options
from skinmap.errors import OutputError
from skinmap.io.output import staged_file, staged_folder
from skinmap.report.page import (
    COLOURS,
    draw_channels,
    heading,
    image,
    note,
    page,
    paragraph,
    picture_bytes,
    plain_figure,
)
from skinmap.report.present import PAGE, emit, show, singular
from skinmap.report.result import REFUSED_CODE, significant
from skinmap.report.table import Table
from skinmap.soundness.examination import Examined, ExaminedFile, arrays_of, examine_tracks, mend
from skinmap.soundness.finding import Finding
from skinmap.soundness.survey import Survey
from skinmap.soundness.track import Track, files_of, placed, tracks
from skinmap.summary import first_few

MOST = 3  # stretches of rows in a line


@click.command("examine")
@click.argument("files", nargs=-1, required=True, metavar="FILE...",
                type=options.PATH)  # fmt: skip
@options.word("--robot", "ROBOT", "Robot of recordings that do not name theirs.")
@options.out_folder("a page with pictures")
@options.file_option("--mend", options.Written(".npz"), "Mended copy of one recording: an NPZ.")
@options.prints(Examined)
def command(
    files: tuple[Path, ...], robot: str | None, out: Path | None, mend: Path | None, as_json: bool
) -> None:
    """Find the faults of recordings: times, channels, rest, labels, and one recording twice.

    FILE is a recording of any kind, or a folder of them: NPZ of `samples` (t, n) and `times` (t,),
    CSV with a column `time`, MAT, MCAP, XDF, bags of ROS 2. No mapping is needed; --robot adds the
    places of the channels, and finds those that answer elsewhere. --mend writes a
    copy with its rows in order, without repeated ones, clocks aligned and other faults as marks.
    Exit code 3: findings that matter.

    \b
    Example:  skinmap examine touches.npz --json
    """
    given = (one for path in files for one in files_of(path))
    if mend is not None and mend.exists() and any(mend.samefile(one) for one in given):
        raise OutputError(f"cannot write {str(mend)!r}: it is one of those that are read")
    found = list(tracks(list(files)))
    if robot is not None:
        known = options.named_robot(robot)
        found = [one if one.places is not None else placed(one, known) for one in found]
    result, surveys = examine_tracks(found)
    if mend is not None and len(surveys) > 1:
        raise click.UsageError(f"--mend takes one recording, not {len(surveys)}")
    written = []
    if mend is not None:
        _mend(found[0], mend)
        written.append(mend)
    if out is not None:
        with staged_folder(out) as stage:
            (stage / PAGE).write_text(examined_page(result, surveys), encoding="utf-8")
        written.append(out / PAGE)
    if as_json:
        emit(result, significant)
    else:
        show(lines(result))
        show(str(path) for path in written)
    if not result.sound:
        raise SystemExit(REFUSED_CODE)


def _mend(track: Track, path: Path) -> None:
    """Write the mended copy of a recording."""
    mended, done = mend(track)
    with staged_file(path) as stage:
        np.savez_compressed(stage, **arrays_of(mended, done))


def lines(result: Examined) -> Iterator[str | Table]:
    """The findings in words."""
    for one in result.files:
        rate = "no times" if one.rate_hz is None else f"{one.rate_hz:.4g} Hz"
        count = len(one.findings)
        state = f"{count} finding{'s'[: count > 1]}" if count else "sound"
        yield f"{one.file}: {one.rows} rows of {one.channels} channels, {rate}: {state}"
        for found in one.findings:
            yield from _words(found)
    if result.findings:
        yield "Together:"
        for found in result.findings:
            yield from _words(found)


def _words(found: Finding) -> Iterator[str]:
    mark = "!" if found.matters else " "
    yield f" {mark} {found.kind}: {found.text} ({found.confidence:.0%} sure)"
    if found.rows:
        spans = [f"{a}" if a == b else f"{a} to {b}" for a, b in found.rows]
        yield f"     rows {first_few(spans, MOST)}"
    yield f"     do: {found.do}"


MOST_SPANS = 400


def examined_page(result: Examined, surveys: list[Survey]) -> str:
    """The HTML of an examination."""
    state = "Sound" if result.sound else "Findings that matter"
    return page(
        singular(f"{state}: {len(result.files)} recordings"), list(_sections(result, surveys))
    )


def _sections(result: Examined, surveys: list[Survey]) -> Iterator[str]:
    if result.findings:
        yield heading("Together")
        yield _table(result.findings)
    for file, survey in zip(result.files, surveys, strict=True):
        yield heading(file.file)
        rate = "no times" if file.rate_hz is None else f"{file.rate_hz:.4g} Hz"
        yield paragraph(f"{file.rows} rows of {file.channels} channels, {rate}.")
        yield _table(file.findings) if file.findings else paragraph("No findings.")
        yield image(_time_line(file, survey), "Load of the skin over time, and its faults")
        yield image(_channels(file, survey), "Channels by their state")
        line = next((one for one in file.findings if isinstance(one.slope, float)), None)
        if line is not None and survey.track.reference is not None:
            yield image(_clocks(line, survey), "Skin and reference, as recorded and aligned")
        yield note("Channels and rows count from 0.")


def _table(findings: list[Finding]) -> str:
    rows = [
        [one.kind, one.text, one.do, f"{one.confidence:.0%}", "yes" if one.matters else "no"]
        for one in findings
    ]
    return Table(("kind", "finding", "remedy", "sure", "matters"), rows).html()


def _time_line(file: ExaminedFile, survey: Survey) -> bytes:
    """Load of the skin, and a bar for each kind of fault."""
    figure = plain_figure((11.0, 3.6))
    load, bars = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    rows = np.arange(len(survey.mean)) * survey.cell
    load.plot(rows, np.percentile(survey.response, 98.0, axis=1), color="#1d2733", lw=0.8)
    load.set_ylabel("load")
    placed = [one for one in file.findings if one.rows]
    kinds = list(dict.fromkeys(one.kind for one in placed))
    for place, kind in enumerate(kinds):
        spans = [tuple(span) for one in placed if one.kind == kind for span in one.rows or []]
        least = file.rows / 400  # seen at all
        several = [(a, max(b - a, least)) for a, b in spans[:MOST_SPANS]]
        bars.broken_barh(several, (place - 0.4, 0.8), color=COLOURS[place % len(COLOURS)])
    bars.set_yticks(range(len(kinds)), kinds)
    bars.set_ylim(-0.6, max(len(kinds) - 0.4, 0.6))
    bars.set_xlim(0, file.rows)
    bars.set_xlabel("row")
    return picture_bytes(figure)


def _channels(file: ExaminedFile, survey: Survey) -> bytes:
    """Each channel at its place, or in rows of a grid, coloured by its first fault."""
    states: dict[int, str] = {}
    for one in file.findings:
        for channel in one.channels or ():
            states.setdefault(channel, one.kind)
    places = survey.track.places
    if places is not None and np.isfinite(places).all(axis=1).any():
        centred = places - np.nanmean(places, axis=0)
        known = np.isfinite(centred).all(axis=1)
        axes = np.linalg.svd(centred[known], full_matrices=False)[2][:2]
        at = centred @ axes.T
    else:
        wide = int(np.ceil(np.sqrt(file.channels * 3)))
        at = np.array([(k % wide, -(k // wide)) for k in range(file.channels)], float)
    figure = plain_figure((11.0, 4.2))
    draw_channels(figure.subplots(), at, states)
    return picture_bytes(figure)


def _clocks(line: Finding, survey: Survey) -> bytes:
    """Median of the skin beside the reference, as recorded and by the line."""
    assert isinstance(line.offset_rows, float)
    assert isinstance(line.slope, float)
    reference = np.asarray(survey.track.reference, float)
    skin = np.median(survey.mean[:, ~survey.constant], axis=1) * survey.sign
    rows = np.arange(len(skin)) * survey.cell
    own = np.arange(len(reference))
    figure = plain_figure((11.0, 4.0))
    for axis, at, title in zip(
        figure.subplots(2, 1, sharex=True),
        (own, own + line.offset_rows + line.slope * own),
        ("as recorded", "aligned"),
        strict=True,
    ):
        axis.plot(rows, _unit(skin), color="#1d2733", lw=0.8, label="skin")
        axis.plot(at, _unit(reference), color=COLOURS[0], lw=0.8, label="reference")
        axis.set_title(title, loc="left", fontsize=9)
        axis.set_yticks([])
    axis.set_xlabel("row of the skin")
    axis.legend(loc="upper right", frameon=False)
    return picture_bytes(figure)


def _unit(series: np.ndarray) -> np.ndarray:
    low, high = np.nanpercentile(series, (0.5, 99.5))
    return (series - low) / max(high - low, 1e-12)
