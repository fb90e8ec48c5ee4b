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

    All times of a file are moved by one shift: a file begins 1 s after the end of the one before.
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
        Recordings of different robots, skins or rates; of different parts, in MCAP.
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
    felt_by = {file: sorted({one.part for one in found}) for file, found in read.items()}
    for file, own in felt_by.items():
        if output.suffix.lower() == ".mcap" and own != felt_by[files[0]]:
            # A sample of MCAP holds all parts: a part that a file lacks would read zero there.
            raise SkinMismatchError(
                f"{file} holds {', '.join(own)}, {files[0]} {', '.join(felt_by[files[0]])}: "
                "recordings of different parts can be joined in .npz only"
            )
    robot = next(iter(robots), "")
    model = named_robot(robot) if robot else None
    parts: dict[str, list[tuple[str, Recording, float]]] = {}
    stuck, end = 0, 0.0
    for file, found in read.items():
        known = [one.times for one in found if len(one.times)]
        shift = end - min((float(one[0]) for one in known), default=0.0)
        end = max((float(one[-1]) + shift + APART for one in known), default=end)
        for one in found:
            felt = one
            skin = model.skin(one.part) if model and one.part in model.parts else None
            if skin is not None and len(skin) == one.pressures.shape[1]:
                felt, _ = without_stuck(one, PreparedSkin(skin).geometry)
            stuck += len(one.labels) - len(felt.labels)
            parts.setdefault(one.part, []).append((sessions[file], felt, shift))
    joined = [join(own) for own in parts.values()]
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


def join(recordings: Sequence[tuple[str, Recording, float]]) -> Recording:
    """Recordings of one part, each with its session and the time [s] to move it by.

    Raises
    ------
    SkinMismatchError
        Another number of taxels, another layout, or another rate.
    """
    import numpy as np

    from skinmap.touch.recording import Recording

    _, first, _ = recordings[0]
    layouts = {one.fingerprint for _, one, _ in recordings if one.fingerprint}
    for session, one, _ in recordings[1:]:
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
    events, count = [], 0
    motions: list[TrueMotion | None] = []
    for _, one, shift in recordings:
        events.append(np.where(one.events >= 0, one.events + count, -1))
        count += len(one.labels)
        truth = one.motions or (None,) * len(one.labels)
        motions += [None if true is None else true.shifted(shift) for true in truth]
    owned = [one.owners for _, one, _ in recordings]
    nobody = [np.full((len(one.labels), one.pressures.shape[1]), -1) for _, one, _ in recordings]
    filled = [none if own is None else own for own, none in zip(owned, nobody, strict=True)]
    owners = None if all(own is None for own in owned) else np.concatenate(filled)
    return Recording(
        first.part,
        np.concatenate([one.times + shift for _, one, shift in recordings]),
        np.concatenate([one.pressures for _, one, _ in recordings]),
        np.concatenate(events),
        tuple(label for _, one, _ in recordings for label in one.labels),
        np.concatenate([one.subjects for _, one, _ in recordings]),
        owners,
        robot=first.robot,
        sessions=tuple(said or name for name, one, _ in recordings for said in one.sessions),
        people=tuple(who for _, one, _ in recordings for who in one.people),
        motions=tuple(motions) if any(motions) else (),
    )


def _lines(result: MergeResult) -> Iterator[str]:
    named = ", ".join(f"{count} {label}" for label, count in result.touches.items()) or "none"
    for part, samples in result.parts.items():
        yield f"{part}: {samples} samples"
    yield f"{sum(result.touches.values())} touches: {named}"
    if result.stuck:
        yield f"{result.stuck} marks left out: only stuck taxels were pressed"
    if len(result.recordings) > 1:
        yield f"times moved: each recording begins {APART:g} s after the end of the one before"
    yield f"sessions: {', '.join(f'{count} {name}' for name, count in result.sessions.items())}"
