"""`skinmap record`: what a source sends, into a file that survives."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinmap.commands import options
from skinmap.commands.overwriting import protect
from skinmap.commands.progress import is_quiet
from skinmap.errors import MessageError, OutputError, UnknownNameError, warn
from skinmap.report.present import present, singular

if TYPE_CHECKING:
    from skinmap.live.loop import TouchLoop
    from skinmap.live.recording.recorder import Recorder, RecordingTap

LIVE_PATIENCE, FILE_PATIENCE = 1.0, 60.0  # seconds to wait for a slow disk before dropping
LOOKED_AT = 200  # samples from which a recording is examined
SHOWN, LOGGED = 0.25, 5.0  # seconds between two lines on a terminal, and in a log


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordResult:
    """Content of a new recording.

    Attributes
    ----------
    samples, dropped
        Written, and lost because the disk was too slow.
    counts
        Number of samples by what became of them on the way here.
    touches
        Number of marked touches by label; empty without --label and --model.
    withdrawn
        Number of touches taken back because their taxels were stuck.
    bytes
        Size of all files.
    files
        In the order in which they were begun.
    """

    samples: int
    dropped: int
    counts: dict[str, int]
    touches: dict[str, int]
    withdrawn: int
    bytes: int
    files: list[str]


@click.command("record")
@click.argument("source")
@options.out_file("MCAP file to write.", required=True, guarded=False)
@options.robot_option
@options.part_option
@options.seconds_option("Stop after this time [s].")
@options.word("--label", "LABEL", "Mark every touch with this name, to train on.")
@click.option("--model", type=options.PATH, help="Mark every touch with a model's label.")
@options.word("--session", "WORDS", "Name of the session, for --leave-out of `evaluate`.")
@options.word("--person", "WORDS", "Name of the person who touches, for --leave-out of `evaluate`.")
@options.calibration_option
@options.speed_option("recorded or simulated")
@options.seed_option
@options.prints(RecordResult)
def command(
    source: str,
    output: Path,
    robot: str | None,
    parts: tuple[str, ...],
    seconds: float | None,
    label: str | None,
    model: Path | None,
    session: str | None,
    person: str | None,
    calibrations: tuple[str, ...],
    speed: float,
    seed: int,
    as_json: bool,
) -> None:
    """Record SOURCE until it ends, the time is over, or Ctrl-C.

    SOURCE is sim, mujoco:FILE, lsl:NAME, zmq:HOST:PORT or a recording. At most 0.2 s are lost
    if the process is killed; a full disk ends the recording, and the written part stays readable.
    Of a source of raw values, --label and --model record the pressures too. Touches are marked when
    they end, grouped as `classify` groups them: a hand is one touch, whatever contacts it makes.
    With --calibration the file holds the wrench of each touch [N, N m] and its covariance.

    \b
    Example:  skinmap record lsl:demo -o touch.mcap --seconds 60
              skinmap record sim --label poke --part torso --person ada -o poke.mcap
    """
    from skinmap.interrupts import interrupted_once
    from skinmap.live.loop import TouchLoop
    from skinmap.live.recording.recorder import Recorder, RecordingTap, continued
    from skinmap.live.response.loads import load_calibrations
    from skinmap.live.sources.source import Seekable, blocks
    from skinmap.recognition.classifier import GivenName
    from skinmap.recognition.model_file import load_classifier
    from skinmap.touch.prepared_skin import PreparedSkin
    from skinmap.touch.recording import check_label

    if label is not None and model is not None:
        raise click.UsageError("--label and --model both name the touches; give one")
    if output.suffix.lower() != ".mcap":
        raise UnknownNameError("format to record in for files ending in", output.suffix, [".mcap"])
    _check_output(output, source)
    if calibrations and label is None and model is None:
        raise click.UsageError("--calibration weighs the touches of --label or --model; give one")
    classifier = None if model is None else load_classifier(model)
    if label is not None:
        classifier = GivenName(check_label(label))
    session, person = (check_label(one) if one else "" for one in (session, person))
    loaded, origin = options.open_stream(source, robot, parts, seed=seed, speed=speed)
    named = classifier is not None
    shown = _Shown(output, sys.stderr, named=named)
    loop = None
    with closing(origin), closing(shown):
        weighed = origin.info.parts if calibrations else ()
        skins = {part: PreparedSkin(loaded.skin(part)) for part in weighed}
        loads = load_calibrations(calibrations, skins)
        for path in continued(output):
            path.unlink()  # of the recording that --force replaces
        dense = tuple(len(loaded.skin(part)) for part in origin.info.parts)
        recorder = Recorder(
            output,
            origin.info,
            robot=loaded,
            widths={"pressure": dense} if named else None,  # of a source of raw values
            session=session,
            person=person,
        )
        patience = FILE_PATIENCE if isinstance(origin, Seekable) else LIVE_PATIENCE
        recorded = RecordingTap(
            origin, recorder, patience=patience, seconds=seconds, looks=not named
        )
        try:
            with interrupted_once(), closing(recorder), suppress(KeyboardInterrupt):
                if named:
                    # Whatever the machine has to do: the same marks for the same samples.
                    loop = TouchLoop(
                        loaded, recorded, classifier=classifier, live=False, singly=True,
                        calibrations=loads,
                    )  # fmt: skip
                    _follow(loop, recorder, shown)
                else:
                    for block in blocks(recorded):
                        shown.add(len(block))
            found = (recorded.unfit if loop is None else loop.counts).joined(origin.counts)
            if not recorder.counts.written and (found.refused or found.short or found.long):
                raise MessageError(f"{source} sent nothing that can be recorded: {found.faults()}")
        except Exception:
            for file in recorder.files:
                if file.exists() and recorder.counts.written:
                    click.echo(f"written until then: {file}", err=True)
                else:
                    file.unlink(missing_ok=True)
            raise
    result = RecordResult(
        samples=recorder.counts.written,
        dropped=recorder.counts.dropped,
        counts=found.as_dict(),
        touches=dict(sorted(shown.touches.items())),
        withdrawn=shown.withdrawn,
        bytes=sum(file.stat().st_size for file in recorder.files),
        files=[str(file) for file in recorder.files],
    )
    present(result, _lines, as_json=as_json)
    if not named and (marks := getattr(origin, "marks", ())):
        click.echo(
            f"note: the {len(marks)} marks of {source} are not copied; `skinmap export` keeps them",
            err=True,
        )
    _warn(recorded, output)


def _warn(recorded: RecordingTap, output: Path) -> None:
    """In one line the worst fault that would falsify what is trained on the recording."""
    import numpy as np

    from skinmap.soundness.examination import FALSIFYING, examine_track
    from skinmap.soundness.track import Track

    if sum(map(len, recorded.kept)) < LOOKED_AT:
        return
    values = np.concatenate([one.values for one in recorded.kept])
    times = np.concatenate([one.times for one in recorded.kept])
    found = examine_track(Track(str(output), values, times))[0].findings
    worst = next((one for one in found if one.kind in FALSIFYING), None)
    if worst is not None:
        more = f"`skinmap examine {output}` lists all findings"
        warn(f"{worst.text} {more}", above=-1)


def _check_output(output: Path, source: str) -> None:
    """Refuse to replace a recording, or to write into the one that is played."""
    from skinmap.live.recording.recorder import continued

    if output.exists() and Path(source).exists() and output.samefile(source):
        raise OutputError(f"cannot write {str(output)!r}: it is the recording being played")
    for path in (output, *continued(output)):
        protect(path, data=True)


def _lines(result: RecordResult) -> Iterator[str]:
    from skinmap.live.sources.source import Counts

    size = result.bytes / 1e6
    yield f"{result.samples} samples, {result.dropped} dropped, {size:.1f} MB"
    if faults := Counts(**result.counts).faults():
        yield f"on the way: {faults}"
    if result.touches:
        yield _counted(result.touches)
    if result.withdrawn:
        yield f"{result.withdrawn} taken back and not marked: the taxels are stuck"


def _counted(touches: dict[str, int]) -> str:
    named = ", ".join(f"{count} {label}" for label, count in sorted(touches.items()))
    return singular(f"{sum(touches.values())} touches: {named}") if touches else "0 touches"


class _Shown:
    """Samples, touches and labels so far: one line that is written over, or lines in a log."""

    def __init__(self, output: Path, stream: Any, *, named: bool) -> None:
        self.touches: Counter[str] = Counter()
        self.withdrawn = 0
        self._name, self._stream, self._named = output.name, stream, named
        self._quiet, self._over = is_quiet(), stream.isatty()
        self._samples, self._told, self._width = 0, time.monotonic(), 0

    def add(self, samples: int = 0, label: str = "") -> None:
        """Count, and say so where the last line is old enough."""
        self._samples += samples
        if label:
            self.touches[label] += 1
        now = time.monotonic()
        if not self._quiet and now - self._told >= (SHOWN if self._over else LOGGED):
            self._told = now
            line = f"{self._name}: {self._samples} samples"
            if self._named:
                line += f", {_counted(self.touches)}"
            self._stream.write(f"\r{line:{self._width}}" if self._over else f"{line}\n")
            self._stream.flush()
            self._width = len(line) if self._over else 0

    def close(self) -> None:
        """Wipe the line, where there is one."""
        if self._width:
            self._stream.write("\r" + " " * self._width + "\r")
            self._stream.flush()


def _follow(loop: TouchLoop, recorder: Recorder, shown: _Shown) -> None:
    """Record samples, pressures and, once each is over, touches with their names."""
    from skinmap.live.publishing.ros2_topics import touch_markers

    with suppress(KeyboardInterrupt):
        for moment in loop:
            if moment.stale:
                continue
            if loop.info.kind == "raw":
                recorder.put(_pressure_block(moment, loop.info.parts), "pressure")
            recorder.show_touches(moment.time, touch_markers(loop.robot, moment))
            shown.add(1)
            _mark_ended(loop, recorder, shown)
    loop.finish()
    _mark_ended(loop, recorder, shown)


def _mark_ended(loop: TouchLoop, recorder: Recorder, shown: _Shown) -> None:
    """Mark the touches that are over; one without a name, or cut off, is nothing to train on."""
    from skinmap.recognition.answers import answers_object
    from skinmap.touch.recording import RESERVED

    shown.withdrawn += len(loop.withdrawn())
    for event in loop.finished():
        if event.label not in RESERVED and not event.unfinished:
            recorder.mark(
                event.part,
                event.identity,
                event.label,
                began=event.began,
                ended=event.ended,
                channels=event.channels,
                answers=None if event.answers is None else answers_object(event.answers),
            )
            shown.add(label=event.label)


def _pressure_block(moment: Any, parts: tuple[str, ...]) -> Any:
    import numpy as np

    from skinmap.live.sources.source import Block

    row = np.concatenate([np.asarray(moment.pressures[part]) for part in parts])
    # Counts, as a classifier is trained on; a response calibration gives fractions of them.
    counts = np.rint(row).clip(0, 255).astype(np.uint8)
    return Block(np.array([moment.time]), counts[None], 0.0)
