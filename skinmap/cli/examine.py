"""`skinmap examine`: faults of recordings, in order of harm."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click

from skinmap.commands.options import PATH, Written, file_option, named_robot, out_folder, prints
from skinmap.errors import OutputError
from skinmap.io.output import staged_file, staged_folder
from skinmap.report.present import PAGE, emit, show
from skinmap.report.result import REFUSED_CODE, significant
from skinmap.report.table import Table
from skinmap.soundness.examination import Examined, arrays_of, examine_tracks, mend
from skinmap.soundness.finding import Finding
from skinmap.soundness.track import Track, files_of, placed, tracks
from skinmap.summary import first_few

MOST = 3  # stretches of rows in a line


@click.command("examine")
@click.argument("files", nargs=-1, required=True, metavar="FILE...",
                type=PATH)  # fmt: skip
@click.option("--robot", metavar="ROBOT", help="Robot of recordings that do not name theirs.")
@out_folder("a page with pictures")
@file_option("--mend", Written(".npz"), "Mended copy of one recording: an NPZ.")
@prints(Examined)
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
        known = named_robot(robot)
        found = [one if one.places is not None else placed(one, known) for one in found]
    result, surveys = examine_tracks(found)
    if mend is not None and len(surveys) > 1:
        raise click.UsageError(f"--mend takes one recording, not {len(surveys)}")
    written = []
    if mend is not None:
        _mend(found[0], mend)
        written.append(mend)
    if out is not None:
        from skinmap.cli.examined_page import examined_page

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
    import numpy as np

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
