"""Recordings of self-touch as events: which taxels were active on both sides, in which pose.

A file of events `NAME.npz` holds `chain1`, `chain2` (parts, or probes), `q (m, joints)` [rad],
`joint_names (joints,)`, perhaps `robot`, and of each side with taxels `ids_PART` with
`ptr_PART (m + 1,)`: event i activated the channels `ids[ptr[i]:ptr[i + 1]]`. Recordings of samples
(MCAP, or NPZ of `skinmap export`) become events here: while the same two parts are active a contact
lasts. Its firmest sample stands for it; where the robot slides or rolls along itself, each few
degrees of any joint begin another.

Probes of self-touch: fingertips without taxels, and what they sit on (TOML).

[[probe]]
name = "right_finger"     # as recordings name it
link = "r_hand"           # link of the robot that it sits on; or
part = "right_hand"       # the part on whose link it sits
tip_mm = [-120, -15, 10]  # where the tip is thought to be in that link, if at all
radius_mm = 7             # how round it is, if that is known

Parts of a robot without a URDF: chains from rows of Denavit and Hartenberg, beside recordings.

`part_NAME.npz` of each chain with taxels holds `taxel_pos (n, 3)` [m] (NaN where an id has no
taxel), `mount (6,)` (translation [m], rotation vector [rad]), `dh (k, 4)` (a, d, alpha, offset) and
`joint_cols`, the columns of the recordings' angles. A probe has such a file of its own, or sits on
the part that a file of probes names.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calibration.files.mount_files import active_by_event, read_arrays
from calibration.mount.chains import Chain, TouchRecording
from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, check_whole
from skinmap.errors import DAMAGED_ARCHIVE, DataFormatError, InvalidArrayError, MissingFileError
from skinmap.geometry.rigid import rigid_transform
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.io.text import is_file, read_toml
from skinmap.skin.normals import NEIGHBOURS, patch_labels, repair_normals

KEYS = ("name", "link", "part", "tip_mm", "radius_mm")
BESIDE = "probes.toml"  # read from beside the recordings where no other is named
MAX_MM = 5000.0  # of a tip in its link: more are other units


@dataclass(frozen=True, eq=False, slots=True)
class Probe:
    """A point of a robot that touches skin and feels nothing.

    Attributes
    ----------
    name : str
    link, part : str
        Link that it sits on, or part on whose link it sits; one of them is empty.
    tip : (3,) float or None
        Where it is thought to be in that link [m].
    radius : float
        [m]; 0 where it is not known.
    """

    name: str
    link: str = ""
    part: str = ""
    tip: FloatArray | None = None
    radius: float = 0.0

    @property
    def mount(self) -> FloatArray:
        """(4, 4) of the assumed tip; the identity where there is none."""
        return rigid_transform(np.eye(3), np.zeros(3) if self.tip is None else self.tip)


def read_probes(path: Path) -> dict[str, Probe]:
    """The probes of a file by their names.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or one that is no list of probes (names it, with the reason).
    """
    if not is_file(path):
        raise MissingFileError(path, "a file of probes (.toml)")
    document = read_toml(path)
    entries = document.get("probe")
    if set(document) - {"probe"} or not isinstance(entries, list):
        raise DataFormatError(
            f"a file of probes holds [[probe]] only, got {', '.join(document) or 'nothing'}", path
        )
    probes: dict[str, Probe] = {}
    for number, entry in enumerate(entries, start=1):
        probe = _probe(entry, f"[[probe]] number {number}", path)
        if probe.name in probes:
            raise DataFormatError(f"two probes are called {probe.name!r}", path)
        probes[probe.name] = probe
    return probes


def _probe(entry: Any, what: str, path: Path) -> Probe:
    if not isinstance(entry, dict) or (unknown := [key for key in entry if key not in KEYS]):
        wrong = ", ".join(unknown) if isinstance(entry, dict) else repr(entry)
        raise DataFormatError(f"{what}: unknown {wrong}; the keys are: {', '.join(KEYS)}", path)
    words = {key: entry.get(key, "") for key in ("name", "link", "part")}
    for key, value in words.items():
        if not isinstance(value, str):
            raise DataFormatError(f"{what}: {key} must be a text, got {value!r}", path)
    if not words["name"]:
        raise DataFormatError(f"{what} lacks 'name'", path)
    if bool(words["link"]) == bool(words["part"]):
        raise DataFormatError(f"probe {words['name']!r} needs either 'link' or 'part'", path)
    try:
        tip = check_finite(entry["tip_mm"], "tip_mm", (3,)) if "tip_mm" in entry else None
        radius = float(check_finite([entry.get("radius_mm", 0.0)], "radius_mm", (1,))[0])
    except InvalidArrayError as error:
        raise DataFormatError(f"probe {words['name']!r}: {error}", path) from None
    if not 0.0 <= radius <= MAX_MM or (tip is not None and np.abs(tip).max() > MAX_MM):
        raise DataFormatError(
            f"probe {words['name']!r}: lengths are millimetres, {MAX_MM:.0f} at most", path
        )
    return Probe(**words, tip=None if tip is None else 1e-3 * tip, radius=1e-3 * radius)


PART = "part_"
SUFFIXES = (".npz", ".mcap")
TURN = 2.0 * np.pi  # no joint that touches its own body is read beyond it, but all in degrees are
EXPECTED = "a recording of self-touch (.npz or .mcap)"
ACTIVE = 10  # counts: above what response calibration leaves of noise (4), below a light touch
ROLLED = np.deg2rad(4.0)  # how far a joint turns until a contact counts as another


@dataclass(frozen=True, eq=False, slots=True)
class TouchFile:
    """A recording as it was read: names of its joints (none where it does not say), its robot.

    `skins` are the fingerprints of its parts' skins, where it says so.
    """

    touches: TouchRecording
    joints: tuple[str, ...]
    robot: str
    path: Path
    skins: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, slots=True)
class SelfTouchData:
    """Recordings and the chains that they name, ready to be fitted.

    Attributes
    ----------
    recordings : list of TouchRecording
    chains : dict of str to Chain
    joints : tuple of str
        Names of the angles' columns; none where no file says.
    robot, base : str
        The robot's name and the link that all chains begin at; empty without a robot.
    links : dict of str to str
        Link (without a robot: part) that each chain ends in.
    notes : tuple of str
        What deserves a second look.
    """

    recordings: list[TouchRecording]
    chains: dict[str, Chain]
    joints: tuple[str, ...] = ()
    robot: str = ""
    base: str = ""
    links: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def touch_files(paths: Sequence[Path]) -> list[Path]:
    """Recordings that are named, or all of a folder.

    Raises
    ------
    MissingFileError
        A file that does not exist, or a folder without a recording.
    """
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            inside = [file for file in sorted(path.iterdir()) if file.suffix.lower() in SUFFIXES]
            found = [file for file in inside if not file.name.startswith(PART)]
            if not found:
                raise MissingFileError(path / "*.npz", "recordings of self-touch (.npz or .mcap)")
            files += found
        elif is_file(path):
            files.append(path)
        else:
            raise MissingFileError(path, EXPECTED)
    return files


def find_probes(file: Path | None, recordings: Iterable[Path]) -> dict[str, Probe]:
    """The probes of a file, or of `probes.toml` beside the recordings; none without either."""
    if file is not None:
        return read_probes(file)
    found: dict[str, Probe] = {}
    for folder in dict.fromkeys(path.parent for path in recordings):
        if is_file(folder / BESIDE):
            found = {**read_probes(folder / BESIDE), **found}
    return found


def read_touches(path: Path, probes: Mapping[str, Probe]) -> tuple[list[TouchFile], list[str]]:
    """The recordings in one file, one for each two sides that touched, and what was left out.

    Raises
    ------
    MissingFileError, DataFormatError
        A file that does not exist, or does not follow a format (names what it lacks).
    """
    if path.suffix.lower() == ".mcap":
        from skinmap.io.mcap.reading import read_track
        from skinmap.io.recordings.recorded_stream import warn_of_loss

        track = warn_of_loss(read_track(path), path)
    else:
        from skinmap.io.recordings.learning import track_of_arrays

        arrays = read_arrays(path, "a recording of self-touch")
        if "head" in arrays:
            raise DataFormatError(
                "a recording without joint angles; `skinmap record` into .mcap keeps them", path
            )
        if "about" not in arrays:
            return [_events_file(arrays, path)], []
        try:
            track = track_of_arrays(arrays, path)
        except DAMAGED_ARCHIVE as error:
            if isinstance(error, DataFormatError):
                raise
            raise DataFormatError(f"not a recording that was exported: {error}", path) from error
    found = track_events(track, probes, path)
    files = [
        TouchFile(one, track.joints, track.info.robot, path, track.info.fingerprints)
        for one in found
    ]
    return files, lone_touches(track, found, path)


def write_touches(
    touches: TouchRecording, joints: Sequence[str], path: Path, *, robot: str = ""
) -> None:
    """Write a file of events, `NAME.npz`.

    Parameters
    ----------
    touches : TouchRecording
        Its chains are parts or probes of the robot, its taxels channels.
    joints : sequence of str
        Names of the angles' columns.
    path : Path
    robot : str, optional
        Name of the robot, so that the recording is never taken for one of another.
    """
    arrays: dict[str, NDArray[Any]] = {
        "chain1": np.array(touches.chains[0]),
        "chain2": np.array(touches.chains[1]),
        "q": touches.angles,
        "joint_names": np.array(list(joints)),
        "robot": np.array(robot),
    }
    for name, own in zip(touches.chains, touches.touched, strict=True):
        if own is not None:
            arrays[f"ids_{name}"] = np.concatenate([np.zeros(0, np.int64), *own])
            arrays[f"ptr_{name}"] = np.cumsum([0, *map(len, own)])
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]


def _events_file(arrays: Mapping[str, NDArray[Any]], path: Path) -> TouchFile:
    try:
        chains = (str(arrays["chain1"]), str(arrays["chain2"]))
        if chains[0] == chains[1]:
            raise InvalidArrayError(f"both sides are {chains[0]!r}")
        angles = check_angles(arrays["q"])
        joints = tuple(map(str, arrays.get("joint_names", np.zeros(0)).tolist()))
        if joints and len(joints) != angles.shape[1]:
            raise InvalidArrayError(f"{len(joints)} joint_names for {angles.shape[1]} angles")
        touched = tuple(
            None if f"ids_{name}" not in arrays else active_by_event(arrays, name, len(angles))
            for name in chains
        )
        touches = TouchRecording(path.stem, chains, angles, (touched[0], touched[1]))
        return TouchFile(touches, joints, str(arrays.get("robot", "")), path)
    except KeyError as error:
        raise DataFormatError(
            f"a recording of self-touch lacks {error}; it has: {', '.join(arrays) or 'nothing'}",
            path,
        ) from error
    except InvalidArrayError as error:
        raise DataFormatError(str(error), path) from error


def check_angles(given: Any) -> FloatArray:
    """Joint angles (m, joints) [rad].

    Raises
    ------
    InvalidArrayError
        Not numbers, NaN, or angles beyond a whole turn.
    """
    angles = check_finite(given, "q", (None, None))
    most = float(np.abs(angles).max(initial=0.0))
    if most > TURN:
        raise InvalidArrayError(f"angles of q reach {most:.4g}; radians are expected, not degrees")
    return angles


def track_events(
    track: RecordedStream, probes: Mapping[str, Probe], path: Path
) -> list[TouchRecording]:
    """The contacts of a recording, one `TouchRecording` for each two sides that touched.

    Touches that are marked with the name of a probe, or that only one part felt where there is one
    probe and no two parts ever touched, are of that probe.

    Raises
    ------
    DataFormatError
        No joint angles, raw values, or no contact of two sides.
    """
    known: BoolArray = np.asarray(np.isfinite(track.angles).all(axis=1))
    if not track.joints or not known.any():
        raise DataFormatError(
            "a recording without joint angles; self-touch needs the pose of every sample", path
        )
    if track.kind != "pressure":
        raise DataFormatError(
            "holds raw values only; record pressures (`skinmap record` with --model or --label)",
            path,
        )
    force = _force(track)
    sides = _sides(track, probes, force > 0)
    contacts: dict[tuple[str, str], list[int]] = {}
    for start, stop in _spans(sides, known, track.angles):
        pair = sides[start]
        if pair is not None:
            columns = [track.parts.index(name) for name in pair if name in track.parts]
            firmest = start + int(np.argmax(force[start:stop, columns].min(axis=1)))
            contacts.setdefault(pair, []).append(firmest)
    if not contacts:
        raise DataFormatError(
            f"no two of its parts ({', '.join(track.parts)}) were pressed at the same time, and "
            "no touch is marked with the name of a probe",
            path,
        )
    return [
        _recording(
            track, pair, rows, path.stem if len(contacts) == 1 else f"{path.stem}:{'-'.join(pair)}"
        )
        for pair, rows in contacts.items()
    ]


def lone_touches(track: RecordedStream, found: Sequence[TouchRecording], path: Path) -> list[str]:
    """A note on touches that one part felt alone, and that were left out."""
    if any(side is None for one in found for side in one.touched):
        return []
    lone = (_force(track) > 0).sum(axis=1) == 1
    count = int((np.diff(lone.astype(int), prepend=0) == 1).sum())
    if count == 0:
        return []
    return [f"{path.name}: {count} touches that one part felt alone were left out"]


def _force(track: RecordedStream) -> FloatArray:
    """Counts (t, parts) above what is noise, summed over each part."""
    found = np.zeros((len(track.times), len(track.parts)))
    for rows, values in track.blocks():
        felt = np.where(values > ACTIVE, values, 0.0)
        for number, part in enumerate(track.parts):
            found[rows, number] = felt[:, track.columns(part)].sum(axis=1, dtype=np.float64)
    return found


def _sides(
    track: RecordedStream, probes: Mapping[str, Probe], active: BoolArray
) -> list[tuple[str, str] | None]:
    """The two sides of each sample; None where nothing, one part or more than two are pressed."""
    marked: dict[int, str] = {}
    for touch in track.touches:
        if touch.label in probes:
            marked |= dict.fromkeys(range(touch.first, touch.last + 1), touch.label)
    count = active.sum(axis=1)
    only = next(iter(probes)) if len(probes) == 1 and not marked and (count < 2).all() else ""
    found: list[tuple[str, str] | None] = []
    for row, own in enumerate(active):
        parts = [track.parts[k] for k in np.flatnonzero(own)]
        probe = marked.get(row, only)
        if len(parts) == 2 and not probe:
            found.append((parts[0], parts[1]))
        elif len(parts) == 1 and probe:
            found.append((probe, parts[0]))
        else:
            found.append(None)
    return found


def _spans(
    sides: Sequence[tuple[str, str] | None], known: BoolArray, angles: FloatArray
) -> Iterator[tuple[int, int]]:
    """First sample of each contact and the one after its last."""
    cuts = [0]
    for row in range(1, len(sides)):
        other = sides[row] != sides[row - 1] or known[row] != known[row - 1]
        if other or (known[row] and np.abs(angles[row] - angles[cuts[-1]]).max() > ROLLED):
            cuts.append(row)
    for start, stop in pairwise([*cuts, len(sides)]):
        if known[start] and sides[start] is not None:
            yield start, stop


def _recording(
    track: RecordedStream, pair: tuple[str, str], rows: Sequence[int], name: str
) -> TouchRecording:
    """The active channels of both sides in some samples."""
    values = np.stack([np.asarray(track.values[row : row + 1])[0] for row in rows])
    first, second = (
        _channels(track, side, values) if side in track.parts else None for side in pair
    )
    return TouchRecording(name, pair, track.angles[np.array(rows)], (first, second))


def _channels(track: RecordedStream, part: str, values: NDArray[np.generic]) -> list[IntArray]:
    """Channels of a part above the noise in each of some samples."""
    own = values[:, track.columns(part)]
    table = track.tables.get(part)
    dense = table is not None and len(table.channels) == own.shape[1]
    names = table.channels if table is not None and dense else np.arange(own.shape[1])
    return [np.asarray(names[np.flatnonzero(row > ACTIVE)], np.int64) for row in own]


NOTHING = np.zeros((0, 3))


def load_part_touches(paths: Sequence[Path], beside: Path | None = None) -> SelfTouchData:
    """Recordings from files, or all of a folder, with the parts that lie beside them.

    `beside` is a file of probes; by default the one beside the recordings.

    Raises
    ------
    MissingFileError, DataFormatError
        A file that does not exist, or does not follow the format (names what it lacks).
    """
    files = touch_files(paths)
    probes = find_probes(beside, files)
    recordings, chains, links = [], dict[str, Chain](), dict[str, str]()
    joints: tuple[str, ...] = ()
    for file in files:
        found, _ = read_touches(file, probes)
        for one in found:
            if joints and one.joints and one.joints != joints:
                raise DataFormatError("joint_names differ from those of the files before", file)
            joints = joints or one.joints
            recordings.append(one.touches)
            for name, touched in zip(one.touches.chains, one.touches.touched, strict=True):
                if name in chains:
                    continue
                on = name if touched is not None else _arm(file, name, probes)
                chains[name] = _part(file.parent, on)
                links[name] = on
                if touched is None:
                    chains[name] = _as_probe(chains[name], name, probes.get(name))
    return SelfTouchData(recordings, chains, joints, links=links)


def _arm(file: Path, name: str, probes: Mapping[str, Probe]) -> str:
    """The part whose chain a probe ends."""
    if (file.parent / f"{PART}{name}.npz").is_file():
        return name
    if name in probes and probes[name].part:
        return probes[name].part
    if name in probes:
        raise DataFormatError(
            f"probe {name!r} sits on a link, which needs --robot; without a robot, give the 'part'",
            file,
        )
    there = sorted(path.stem.removeprefix(PART) for path in file.parent.glob(f"{PART}*.npz"))
    raise DataFormatError(
        f"no taxels of {name!r}, and its link is unknown; name it in {BESIDE} beside it: "
        f'[[probe]] name = "{name}", part = one of: '
        f"{', '.join(there) or 'none, so name the --robot'}",
        file,
    )


def _as_probe(part: Chain, name: str, probe: Probe | None) -> Chain:
    own = probe or Probe(name)
    return replace(
        part, name=name, mount=own.mount, taxels=NOTHING, normals=NOTHING, radius=own.radius
    )


def _part(folder: Path, name: str) -> Chain:
    path = folder / f"{PART}{name}.npz"
    if not path.is_file():
        raise MissingFileError(
            path, f"the part that carries the taxels of {name!r}; or name the --robot"
        )
    arrays = read_arrays(path, f"the part that carries the taxels of {name!r}")
    try:
        placed = check_finite(arrays["mount"], "mount", (6,))
        mount = rigid_transform(Rotation.from_rotvec(placed[3:]).as_matrix(), placed[:3])
        joints = check_whole(arrays["joint_cols"], "joint_cols")
        taxels = arrays["taxel_pos"]
        plain = Chain.from_dh(name, arrays["dh"], joints, mount, taxels)
        return replace(plain, normals=bulging_normals(plain.taxels))
    except KeyError as error:
        raise DataFormatError(f"a part lacks {error}", path) from error
    except ValueError as error:
        raise DataFormatError(str(error), path) from error


def bulging_normals(taxels: FloatArray) -> FloatArray:
    """(n, 3) normals of sheets that bulge outwards, as covers of robots do; NaN for no taxel."""
    normals = np.full(taxels.shape, np.nan)
    known = np.isfinite(taxels).all(axis=1)
    points = taxels[known]
    if len(points) <= NEIGHBOURS:
        return NOTHING
    labels = patch_labels(points)
    middles = np.stack([points[labels == label].mean(axis=0) for label in np.unique(labels)])
    normals[known] = repair_normals(points, None, points - middles[labels])
    return normals
