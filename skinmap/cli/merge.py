"""`skinmap merge`: several recordings as one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from skinmap.commands.options import PATH, named_robot, out_file, prints
from skinmap.commands.overwriting import protect
from skinmap.errors import OutputError, SkinMismatchError
from skinmap.io.output import staged_file
from skinmap.report.present import present

if TYPE_CHECKING:
    import numpy as np

    from skinmap.touch.recording import Recording, TrueMotion

APART = 1.0  # seconds between the end of one recording and the beginning of the next
SAME_RATE = 0.01  # share by which rates may differ


@dataclass(frozen=True, kw_only=True, slots=True)
class MergeResult:
    """Recordings joined into one.

    Attributes
    ----------
    recordings
        Files that were read.
    parts
        Number of samples by part.
    touches
        Number of touches by label.
    sessions
        Number of touches by session; a recording without sessions is one session.
    stuck
        Marks that were left out: only stuck taxels were pressed.
    files
        Name of the new recording.
    """

    recordings: list[str]
    parts: dict[str, int]
    touches: dict[str, int]
    sessions: dict[str, int]
    stuck: int
    files: list[str]


@click.command("merge")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...", type=PATH)
@out_file(
    "Recording to write, .mcap or .npz; never one of those that are read.",
    required=True,
    guarded=False,
)
@prints(MergeResult)
def command(recordings: tuple[Path, ...], output: Path, as_json: bool) -> None:
    """Join recordings of one robot, one after the other, with their touches and sessions.

    Pressures are joined; raw values and joint angles stay in the recordings they came from. Of
    recordings of different parts only .npz can be written.

    \b
    Example:  skinmap merge poke.mcap rub.mcap -o both.mcap
    """
    present(work(recordings, output), _lines, as_json=as_json)


def work(paths: Sequence[Path], output: Path) -> MergeResult:
    """Read, join and write.

    Raises
    ------
    OutputError
        A file that is there, or one of those that are read.
    SkinMismatchError
        Recordings of different robots, skins or rates.
    """
    from skinmap.cli.collection import files_of, session_names
    from skinmap.io.recordings.touch_files import check_suffix, read_recordings, save_recordings
    from skinmap.touch.contacts.grouping import without_stuck
    from skinmap.touch.prepared_skin import PreparedSkin

    check_suffix(output)
    files = [file for path in paths for file in files_of(path)]
    for file in files:
        if output.exists() and file.exists() and output.samefile(file):
            raise OutputError(f"cannot write {str(output)!r}: it is one of those that are read")
    protect(output, data=True)
    twice = [str(file) for file, count in Counter(files).items() if count > 1]
    if twice:
        raise click.UsageError(f"given twice: {', '.join(twice)}")
    sessions = session_names(files)
    read = {file: read_recordings(file) for file in files}
    robots = {one.robot: file for file, found in read.items() for one in found if one.robot}
    if len(robots) > 1:
        named = ", ".join(f"{robot} ({file})" for robot, file in robots.items())
        raise SkinMismatchError(
            f"recordings of several robots: {named}; `train` takes them as they are"
        )
    robot = next(iter(robots), "")
    model = named_robot(robot) if robot else None
    parts: dict[str, list[tuple[Path, Recording]]] = {}
    stuck = 0
    for file, found in read.items():
        for one in found:
            felt = one
            skin = model.skin(one.part) if model and one.part in model.parts else None
            if skin is not None and len(skin) == one.pressures.shape[1]:
                felt, _ = without_stuck(one, PreparedSkin(skin).geometry)
            stuck += len(one.labels) - len(felt.labels)
            parts.setdefault(one.part, []).append((file, felt))
    joined = [join([(sessions[file], one) for file, one in own]) for own in parts.values()]
    with staged_file(output) as stage:
        save_recordings(joined, stage, suffix=output.suffix, robot=model)
    labels = Counter(label for one in joined for label in one.labels)
    return MergeResult(
        recordings=[str(file) for file in files],
        parts={one.part: len(one.times) for one in joined},
        touches=dict(sorted(labels.items())),
        sessions=dict(Counter(name for one in joined for name in one.sessions)),
        stuck=stuck,
        files=[str(output)],
    )


def join(recordings: Sequence[tuple[str, Recording]]) -> Recording:
    """Recordings of one part, with their sessions, one after the other.

    Raises
    ------
    SkinMismatchError
        Another number of taxels, another layout, or another rate.
    """
    import numpy as np

    from skinmap.touch.recording import Recording

    _, first = recordings[0]
    layouts = {one.fingerprint for _, one in recordings if one.fingerprint}
    for session, one in recordings[1:]:
        if one.pressures.shape[1] != first.pressures.shape[1] or len(layouts) > 1:
            raise SkinMismatchError(
                f"{session}: {one.part!r} has another skin than in {recordings[0][0]}: "
                f"{one.pressures.shape[1]} and {first.pressures.shape[1]} taxels"
            )
        if abs(one.rate - first.rate) > SAME_RATE * first.rate:
            raise SkinMismatchError(
                f"{session} has {one.rate:.4g} samples a second, {recordings[0][0]} "
                f"{first.rate:.4g}: they do not follow each other; `train` takes both"
            )
    times, events, shift, count = [], [], 0.0, 0
    motions: list[TrueMotion | None] = []
    for _, one in recordings:
        begin = float(one.times[0]) if len(one.times) else 0.0
        times.append(one.times - begin + shift)
        events.append(np.where(one.events >= 0, one.events + count, -1))
        count += len(one.labels)
        truth = one.motions or (None,) * len(one.labels)
        motions += [None if true is None else true.shifted(shift - begin) for true in truth]
        shift = float(times[-1][-1]) + APART if len(one.times) else shift
    owners = None
    if any(one.owners is not None for _, one in recordings):
        owners = np.concatenate([_owners(one) for _, one in recordings])
    return Recording(
        first.part,
        np.concatenate(times),
        np.concatenate([one.pressures for _, one in recordings]),
        np.concatenate(events),
        tuple(label for _, one in recordings for label in one.labels),
        np.concatenate([one.subjects for _, one in recordings]),
        owners,
        robot=first.robot,
        sessions=tuple(said or name for name, one in recordings for said in one.sessions),
        people=tuple(who for _, one in recordings for who in one.people),
        motions=tuple(motions) if any(motions) else (),
    )


def _owners(one: Recording) -> np.ndarray:
    import numpy as np

    if one.owners is not None:
        return one.owners
    return np.full((len(one.labels), one.pressures.shape[1]), -1)


def _lines(result: MergeResult) -> Iterator[str]:
    named = ", ".join(f"{count} {label}" for label, count in result.touches.items()) or "none"
    for part, samples in result.parts.items():
        yield f"{part}: {samples} samples"
    yield f"{sum(result.touches.values())} touches: {named}"
    if result.stuck:
        yield f"{result.stuck} marks left out: only stuck taxels were pressed"
    yield f"sessions: {', '.join(f'{count} {name}' for name, count in result.sessions.items())}"
