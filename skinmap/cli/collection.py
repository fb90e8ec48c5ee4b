"""Recordings of several files, robots, people and sessions, as one collection of touches."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinmap.commands.options import named_robot
from skinmap.errors import MissingFileError, SkinMismatchError, check_known
from skinmap.io.recordings.touch_files import is_readable, read_recordings, readable
from skinmap.io.text import is_file
from skinmap.soundness.examination import falsifying
from skinmap.soundness.track import Track, tracks_of
from skinmap.touch.contacts.grouping import without_stuck
from skinmap.touch.recording import Recording

if TYPE_CHECKING:
    from skinmap.recognition.descriptors import Touch
    from skinmap.skin.robot import Robot
    from skinmap.touch.prepared_skin import PreparedSkin

FIRST = 3  # samples of a stretch in which nobody can have done anything yet
BEFORE = 50  # quiet samples before a touch that are kept: a second of most skins
NUMBERED = re.compile(r"_\d{4}$")  # a file that `record` went on with
SAME_RATE = 1.1  # of two recordings; features of a touch's course differ beyond
FALLBACK = "icub"  # the robot of a file that does not say its own

SIMULATED = "simulated person"


@dataclass(frozen=True, eq=False, slots=True)
class Collected:
    """One marked touch and where it comes from.

    Attributes
    ----------
    touch : Touch
    robot, part, session, person : str
        A person is empty where nobody said who touched.
    file : Path
    before : (r, n) uint8
        What the skin read before it, from the touch before on; nothing was touched.
    first : (f, n) uint8
        The first samples of the stretch that ends with it.
    simulated : bool
        Whether the simulator drew the person.
    """

    touch: Touch
    robot: str
    part: str
    session: str
    person: str
    file: Path
    before: NDArray[np.uint8]
    first: NDArray[np.uint8]
    simulated: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class Collection:
    """Marked touches of several recordings.

    Attributes
    ----------
    touches : tuple of Collected
    skins : dict
        Skin of each robot and part.
    files : tuple of Path
    rates : tuple of float
        Samples a second of each recorded part.
    stuck : int
        Marks that were left out, as nothing but stuck taxels was pressed.
    unsound : tuple of str
        Faults of the recordings for which a figure would be wrong.
    """

    touches: tuple[Collected, ...]
    skins: dict[tuple[str, str], PreparedSkin]
    files: tuple[Path, ...]
    rates: tuple[float, ...]
    stuck: int = 0
    unsound: tuple[str, ...] = ()

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the recorded parts."""
        return tuple(dict.fromkeys(part for _, part in self.skins))

    def count(self, *fields: str) -> dict[Any, int]:
        """How many touches there are of each session, say, or of each (session, person)."""
        return dict(Counter(map(attrgetter(*fields), self.touches)))

    def doubts(self) -> Iterator[str]:
        """What a classifier of these touches may have learnt instead of the touches."""
        labels = self.count("touch.label")
        sessions = self.count("session", "touch.label")
        alone = [label for label in labels if sum(one == label for _, one in sessions) == 1]
        drawn = all(one.simulated for one in self.touches)  # a simulator has no sessions
        if alone and not drawn:
            where = {one: session for session, one in sessions}
            named = ", ".join(f"{label} ({where[label]})" for label in alone)
            yield (
                f"recorded in one session only: {named}; a model can learn the session instead of "
                "the touch; record each label in two or more"
            )
        people = {name for name in self.count("person") if name}
        if len(people) < 2 and not drawn:
            yield "fewer than two people are named (`record --person`): others may touch otherwise"
        if self.stuck:
            yield f"{self.stuck} marked touches were left out: only stuck taxels were pressed"
        yield from self.unsound
        slow, quick = min(self.rates, default=1.0), max(self.rates, default=1.0)
        if quick > SAME_RATE * slow:
            yield f"recorded at {slow:.4g} to {quick:.4g} samples a second: touches look different"


def collect(
    paths: Sequence[Path], robot: str | None = None, parts: Sequence[str] = ()
) -> Collection:
    """Read recordings and folders of them, each on the robot that it names.

    Parameters
    ----------
    paths : sequence of Path
        A mapping (.toml) beside its recording is left out.
    robot : str, optional
        Of all of them, whatever they say.
    parts : sequence of str
        Only these.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, an empty folder, or no recording.
    UnknownNameError
        A part that nobody recorded.
    SkinMismatchError
        A recording of another skin than the robot's.
    """
    data = [path for path in paths if path.is_file() and path.suffix != ".toml"]
    mappings = {path.with_suffix(".toml") for path in data}  # a shell's pattern finds both
    named = [path for path in paths if path not in mappings]
    files = list(dict.fromkeys(found for path in named for found in files_of(path)))
    sessions = session_names(files)
    robots: dict[str, Robot] = {}
    skins: dict[tuple[str, str], PreparedSkin] = {}
    touches: list[Collected] = []
    rates, there, stuck = [], [], 0
    tracks: list[Track] = []
    for file in files:
        recordings = read_recordings(file)
        for recording in recordings:
            said = robot or recording.robot or FALLBACK
            if said not in robots:
                robots[said] = _robot(said, file, asked=robot is not None)
            loaded = robots[said]
            there.append(recording.part)
            if parts and recording.part not in parts:
                loaded.part(recording.part)
                continue
            skin = _skin_of(loaded, recording, file, skins)
            recording, gone = without_stuck(recording, skin.geometry)
            stuck += len(gone)
            touches += _touches(recording, skin, loaded.name, sessions[file], file)
            rates.append(recording.rate)
        if recordings:
            own = tracks_of(recordings, str(file), placed=False)
            tracks += [one for one in own if len(one.values)]
    check_known("recorded part", parts, there)
    unsound = tuple(falsifying(tracks))
    return Collection(tuple(touches), skins, tuple(files), tuple(rates), stuck, unsound)


def _robot(name: str, file: Path, *, asked: bool) -> Robot:
    if not asked and name.endswith(".toml") and not is_file(Path(name)):
        raise MissingFileError(name, f"the robot of {file}; name it with --robot")
    return named_robot(name)


def files_of(path: Path) -> list[Path]:
    """The recordings that a path names: itself, or those in a folder and in its folders."""
    from skinmap.io.ros2.bag import METADATA, recordings_under

    if not path.is_dir() or (path / METADATA).is_file():
        return [path]
    found = [one for one in recordings_under(path) if is_readable(one)]
    if not found:
        raise MissingFileError(path, f"a folder with recordings ({', '.join(readable())})")
    return found


def session_names(files: Sequence[Path]) -> dict[Path, str]:
    """What each file is called as a session of its own; parts of one recording are one session."""
    names = {file: file for file in files}
    for file in files:
        whole = file.with_name(NUMBERED.sub("", file.stem) + file.suffix)
        names[file] = whole if whole in names else file
    several = Counter(one.stem for one in set(names.values()))
    return {file: one.stem if several[one.stem] == 1 else str(one) for file, one in names.items()}


def _skin_of(
    robot: Robot, recording: Recording, file: Path, skins: dict[tuple[str, str], PreparedSkin]
) -> PreparedSkin:
    """The skin that was recorded, prepared once for all files."""
    from skinmap.touch.prepared_skin import PreparedSkin

    key = robot.name, recording.part
    if key not in skins:
        skins[key] = PreparedSkin(robot.skin(recording.part))
    skin = skins[key]
    if recording.pressures.shape[1] != len(skin):
        raise SkinMismatchError(
            f"{file}: the recording of {recording.part!r} has {recording.pressures.shape[1]} "
            f"taxels, the skin of {robot.name} has {len(skin)}"
        )
    if recording.fingerprint:
        from skinmap.skin.skin import fingerprint

        if recording.fingerprint != fingerprint(skin.skin):
            raise SkinMismatchError(
                f"{file}: recorded on another skin: the layout of {recording.part!r} is not that "
                f"of {robot.name!r}"
            )
    return skin


def _touches(
    recording: Recording, skin: PreparedSkin, robot: str, session: str, file: Path
) -> Iterator[Collected]:
    from skinmap.recognition.descriptors import recorded_touches

    part, several = recording.part, len(np.unique(recording.subjects)) > 1
    touches = recorded_touches(skin, recording)
    samples = np.arange(len(recording.events))
    # Behind the last sample of a touch before each sample.
    free = np.maximum.accumulate(np.where(recording.events >= 0, samples + 1, 0))
    for event, (touch, rows) in enumerate(zip(touches, recording.rows(), strict=True)):
        if len(rows) == 0:
            continue
        start = int(rows[0])
        quiet = int(free[start - 1]) if start else 0
        stretch = recording.pressures[quiet : start + len(rows)]
        own = recording.sessions[event] or session
        number = int(recording.subjects[event])
        drawn = several and not recording.people[event]
        person = f"{own}: {SIMULATED} {number}" if drawn else recording.people[event]
        touch = replace(touch, person=person)
        before, first = recording.pressures[max(quiet, start - BEFORE) : start], stretch[:FIRST]
        yield Collected(touch, robot, part, own, person, file, before, first, drawn)
