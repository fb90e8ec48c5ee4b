"""`skinmap label`: name, split, join and delete the touches of a recording, in a new file."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from skinmap.commands.options import PATH, open_robot, out_file, prints, robot_option, word
from skinmap.commands.overwriting import protect
from skinmap.errors import MissingFileError, OutputError, SkinError
from skinmap.io.output import staged_file
from skinmap.report.present import present

if TYPE_CHECKING:
    from skinmap.arrays import FloatArray
    from skinmap.io.recordings.marks import Marks
    from skinmap.io.recordings.recorded_stream import RecordedStream
    from skinmap.skin.robot import Robot
    from skinmap.touch.recording import Recording

TABLE = ".csv"  # of touches, to edit elsewhere


@dataclass(frozen=True, kw_only=True, slots=True)
class LabelResult:
    """Touches of a recording after labelling.

    Attributes
    ----------
    before
        Touches that the recording had marked.
    found
        Number of touches found in the samples, because none was marked or `--find` was
        given.
    touches
        Number of marked touches by label.
    stuck
        Marks that were left out: only stuck taxels were pressed.
    unnamed
        Found ones that nobody named: they are not marked.
    files
        The new recording, or the CSV.
    """

    before: int
    found: int
    touches: dict[str, int]
    stuck: int
    unnamed: int
    files: list[str]


@click.command("label")
@click.argument("recording", type=PATH)
@click.argument("table", required=False, metavar="[TOUCHES.csv]", type=PATH)
@out_file(
    "New recording (.mcap or .npz), or its touches (.csv), to edit and to give back.",
    required=True, guarded=False,
)  # fmt: skip
@click.option("--find", is_flag=True, help="Find the touches again and ignore the marks.")
@word("--name", "LABEL", "Name of all touches without one; outside a terminal no key is asked for.")
@robot_option
@prints(LabelResult)
def command(
    recording: Path,
    table: Path | None,
    output: Path,
    find: bool,
    name: str | None,
    robot: str | None,
    as_json: bool,
) -> None:
    """Name, split, join and delete the touches of RECORDING.

    By keys in the terminal, or by a CSV that is edited elsewhere. Touches that were not marked are
    found first, grouped as `classify` groups them. The recording stays as it is: what comes out is
    a new file.

    \b
    Example:  skinmap label touch.mcap -o named.mcap
              skinmap label touch.mcap -o touches.csv
              skinmap label touch.mcap touches.csv -o named.mcap
    """
    from skinmap.io.recordings.marks import Marks, marks_csv, read_marks
    from skinmap.live.sources.open_source import open_track
    from skinmap.touch.recording import RESERVED, UNNAMED, check_label

    _check(recording, output, changes=table is not None)
    label = None if name is None else check_label(name)
    loaded = open_robot(robot, ())[0]
    track = open_track(recording, robot=loaded)
    own = _pressures(track, recording, output)
    before = _felt(Marks(track.touches), own, loaded)
    finding = find or not len(before)
    marks = _found(recording, loaded, track.times) if finding else before
    found = len(marks) if finding else 0
    if table is not None:
        marks = read_marks(table, marks, track.times, track.parts)
    asks = label is None or sys.stdin.isatty()  # a script that gives the name has no keys to press
    if output.suffix.lower() != TABLE and table is None and asks:
        marks = by_keys(marks, track, recording.name)
    if label is not None:
        every = (
            replace(one, label=label) if one.label == UNNAMED else one for one in marks.touches
        )
        marks = Marks(tuple(every))
    named = Marks(tuple(one for one in marks.touches if one.label not in RESERVED))
    if output.suffix.lower() == TABLE:
        with staged_file(output) as stage:
            stage.write_text(marks_csv(marks, track.times), encoding="utf-8")
    else:
        write_marked_recording(recording, output, named, loaded, own)
    result = LabelResult(
        before=len(before),
        found=found,
        touches=dict(sorted(Counter(one.label for one in named.touches).items())),
        stuck=len(track.touches) - len(before),
        unnamed=len(marks) - len(named),
        files=[str(output)],
    )
    present(result, _lines, as_json=as_json)


def _check(recording: Path, output: Path, *, changes: bool) -> None:
    """Refuse to write over the recording or over a file that is there."""
    from skinmap.io.recordings.touch_files import check_suffix

    if not recording.exists():
        raise MissingFileError(recording, "a recording")
    if output.suffix.lower() != TABLE:
        check_suffix(output)
    elif changes:
        raise click.UsageError("-o TOUCHES.csv writes the marks; a table changes them: -o NEW.mcap")
    if output.exists() and output.samefile(recording):
        raise OutputError(f"cannot write {str(output)!r}: it is the recording; name a new file")
    protect(output, data=True)


def _pressures(track: RecordedStream, path: Path, output: Path) -> list[Recording]:
    """The pressures of a recording, where marks need them or the new file holds nothing else.

    So what cannot be written is refused before the first touch is named.
    """
    from skinmap.io.recordings.touch_files import read_recordings, recordings_of

    if not track.touches and (_keeps(path, output) or output.suffix.lower() == TABLE):
        return []
    return read_recordings(path) if track.touches else recordings_of(track, path)


def _felt(marks: Marks, recordings: list[Recording], robot: Robot) -> Marks:
    """The marks under which more than stuck taxels was pressed."""
    from skinmap.io.recordings.marks import Marks
    from skinmap.touch.contacts.grouping import without_stuck
    from skinmap.touch.prepared_skin import PreparedSkin

    if not len(marks):
        return marks
    stuck = set()
    for one in recordings:
        numbers = sorted({mark.event for mark in marks.touches if mark.part == one.part})
        _, gone = without_stuck(one, PreparedSkin(robot.skin(one.part)).geometry)
        stuck |= {(one.part, numbers[row]) for row in gone.tolist()}
    return Marks(tuple(one for one in marks.touches if (one.part, one.event) not in stuck))


def _found(recording: Path, robot: Robot, times: FloatArray) -> Marks:
    """The touches of a recording of times (t,), as `classify` tells them apart."""
    import numpy as np

    from skinmap.io.recordings.marks import Marks
    from skinmap.io.recordings.recorded_stream import MarkedTouch
    from skinmap.live.loop import TouchLoop
    from skinmap.live.sources.open_source import open_recording
    from skinmap.recognition.classifier import GivenName
    from skinmap.touch.recording import UNNAMED

    source = open_recording(recording, robot=robot, speed=float("inf"))
    loop = TouchLoop(robot, source, classifier=GivenName(FOUND), singly=True)
    over = []
    for _ in loop:
        over += loop.finished()
    over += loop.finished()
    loop.close()
    found = [one for one in over if one.label == FOUND]
    first = np.searchsorted(times, [one.began for one in found]).tolist()
    last = (np.searchsorted(times, [one.ended for one in found], side="right") - 1).tolist()
    rows = zip(found, first, last, strict=True)
    marks = [MarkedTouch(one.part, one.identity, UNNAMED, a, b) for one, a, b in rows]
    return Marks(tuple(marks))


FOUND = "found"  # inside only: what the loop calls each touch


def by_keys(marks: Marks, track: RecordedStream, name: str) -> Marks:
    """Step through the touches in the terminal.

    Raises
    ------
    UsageError
        The end without `w`: nothing is written.
    """
    from skinmap.io.recordings.marks import KEYS, MarkEditor

    editor = MarkEditor(marks, track)
    click.echo(f"{name}: {len(marks)} touches; {KEYS}, w write, q end without writing", err=True)
    while True:
        try:
            line = click.prompt(editor.shown(), default="", show_default=False, err=True)
        except (click.Abort, EOFError):
            raise click.UsageError("ended without w: nothing was written") from None
        key, _, rest = line.strip().partition(" ")
        if key == "w":
            return editor.marks
        if key in ("h", "?"):
            click.echo(f"{KEYS}, w write, q end without writing", err=True)
            continue
        if key == "q":
            raise click.UsageError("ended by q: nothing was written")
        try:
            editor.press(key, rest.strip())
        except (SkinError, ValueError) as error:
            click.echo(str(error), err=True)


def write_marked_recording(
    recording: Path, output: Path, marks: Marks, robot: Robot, own: list[Recording]
) -> None:
    """Write a recording with other marks; raw values and joints are kept from MCAP to MCAP.

    `own` are its pressures; none where it is copied as it is.
    """
    from skinmap.io.mcap.reading import write_marked
    from skinmap.io.recordings.marks import remarked
    from skinmap.io.recordings.touch_files import save_recordings

    with staged_file(output) as stage:
        if _keeps(recording, output):
            write_marked(recording, stage, marks.touches)
            return
        save_recordings([remarked(one, marks, recording) for one in own], stage, robot=robot)


def _keeps(recording: Path, output: Path) -> bool:
    """Whether all that is in a recording is written again: from our MCAP to MCAP."""
    from skinmap.io.ros2.bag import is_bag

    return recording.suffix.lower() == output.suffix.lower() == ".mcap" and not is_bag(recording)


def _lines(result: LabelResult) -> Iterator[str]:
    named = ", ".join(f"{count} {label}" for label, count in result.touches.items()) or "none"
    if result.found:
        yield f"{result.found} touches found"
    yield f"{sum(result.touches.values())} touches marked: {named}"
    if result.stuck:
        yield f"{result.stuck} marks left out: only stuck taxels were pressed"
    if result.unnamed and result.files[0].lower().endswith(".csv"):
        yield f"{result.unnamed} have no name yet: write one in the column `label`"
    elif result.unnamed:
        yield f"{result.unnamed} without a name were left out"
