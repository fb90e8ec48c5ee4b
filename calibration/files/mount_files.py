"""Files of mounts, presses and responses: touches and samples in, taxels and mounts out.

Of presses on a flat surface an `.npz` holds `joints (j,)` (names), `angles (m, j)` [rad, of sliding
joints m] and, of each part, either `active_PART (m, c)` (true where a channel was active) or
`ids_PART` with `ptr_PART (m + 1,)`: press i activated the channels `ids[ptr[i]:ptr[i + 1]]`.
`active_PART` with as many columns as taxels has these in the order of their channels. Perhaps
`surface (m,)`: which of several surfaces was pressed. A recording (`.mcap`) holds joint angles
where its source has them; presses are found in it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.files.tables import read_numbers, write_taxels
from calibration.mount.chains import joint_columns
from calibration.plane.model import PlaneContacts
from skinmap.archive import open_arrays, quiet_headers
from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, check_whole
from skinmap.errors import DAMAGED_ARCHIVE, DataFormatError, InvalidArrayError, check_known
from skinmap.io.recordings.recorded_stream import RecordedStream
from skinmap.io.text import check_file
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin

WRENCH = ("points", "frames", "forces", "moments")
Placed = tuple[IntArray, FloatArray, FloatArray]  # channels, places [m] and covariances of taxels


@dataclass(frozen=True, eq=False, slots=True)
class WrenchTouches:
    """Touches with wrenches; taxels (n, 3) of the patch where there are any."""

    points: FloatArray
    frames: FloatArray
    forces: FloatArray
    moments: FloatArray
    taxels: FloatArray | None


def read_arrays(path: Path, expected: str) -> dict[str, NDArray[Any]]:
    """The arrays of an `.npz` file; of an `.npy` or `.csv` file, one called "samples".

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or not a file of plain arrays; a row of a `.csv` that has another number of
        channels (names the line).
    """
    check_file(path, expected, most_bytes=2**32)
    if path.suffix.lower() == ".csv":
        return {"samples": read_numbers(path, None)}
    if path.suffix.lower() != ".npy":
        with open_arrays(path, expected) as arrays:
            return {name: arrays[name] for name in arrays.files}
    try:
        with path.open("rb") as file, quiet_headers():
            return {"samples": np.asarray(np.lib.format.read_array(file, allow_pickle=False))}
    except DAMAGED_ARCHIVE as error:
        raise DataFormatError(f"not {expected}: {error}", path) from error


def active_by_event(arrays: Mapping[str, NDArray[Any]], name: str, m: int) -> list[IntArray]:
    """What was active in each of m events: `ids_NAME`, cut at `ptr_NAME (m + 1,)`.

    Raises
    ------
    InvalidArrayError
        No `ptr_NAME`, or one that does not rise from 0 to the number of ids in m steps.
    """
    if f"ptr_{name}" not in arrays:
        raise InvalidArrayError(f"lacks ptr_{name}, the start of each event in ids")
    ids = check_whole(arrays[f"ids_{name}"], f"ids_{name}")
    bounds = check_whole(arrays[f"ptr_{name}"], f"ptr_{name}")
    if bounds.shape != (m + 1,) or bounds[0] != 0 or bounds[-1] != len(ids):
        raise InvalidArrayError(
            f"ptr_{name} must rise from 0 to {len(ids)} in {m} steps, got shape {bounds.shape}"
        )
    if (np.diff(bounds) < 0).any():
        raise InvalidArrayError(f"ptr_{name} falls at {int(np.argmax(np.diff(bounds) < 0))}")
    return np.split(ids, bounds[1:-1])


def read_wrenches(path: Path, unit: float = 1.0) -> WrenchTouches:
    """Touches with wrenches from an `.npz` file.

    Arrays `points (m, 3)`, `frames (m, 4, 4)`, `forces`, `moments`, and perhaps `taxels (n, 3)`.
    Lengths are in `unit` metres, moments in newton times it.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or an array is missing or not of numbers.
    """
    arrays = read_arrays(path, "touches with wrenches (.npz)")
    _need(arrays, WRENCH, path)
    try:
        with np.errstate(over="raise", invalid="raise"):  # of longer floats than ours, of no number
            found = {name: _real(arrays[name]) for name in arrays}
        found["frames"][..., :3, 3:] *= unit
    except (ValueError, TypeError, IndexError, FloatingPointError) as error:
        raise DataFormatError(f"arrays must be numbers: {error}", path) from error
    own = found.get("taxels")
    if own is not None and (own.ndim != 2 or own.shape[1] != 3):
        raise DataFormatError(f"taxels must have shape (n, 3), got {own.shape}", path)
    return WrenchTouches(
        found["points"] * unit,
        found["frames"],
        found["forces"],
        found["moments"] * unit,
        None if own is None else own * unit,
    )


def _real(values: NDArray[Any]) -> FloatArray:
    if values.dtype.kind == "c":
        raise ValueError("complex ones came")
    found = np.array(values, np.float64)
    found[np.isnan(found)] = np.nan  # those that stop a machine at the first sum become quiet
    return found


def read_samples(path: Path, names: tuple[str, ...] = ("samples",)) -> dict[str, NDArray[Any]]:
    """Samples (t, n), and loads of the same shape where they are asked for.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or it lacks one of the arrays.
    """
    arrays = read_arrays(path, f"samples (.npy, or .npz with {', '.join(names)})")
    _need(arrays, names, path)
    return arrays


def rate_of(arrays: Mapping[str, NDArray[Any]], path: Path) -> float | None:
    """Samples a second by the arrays `rate` or `times (t,)` [s]; None where there is neither.

    Raises
    ------
    DataFormatError
        Not one positive number, or times that do not rise.
    """
    if "rate" in arrays:
        rate = np.asarray(arrays["rate"], np.float64).ravel()
    elif "times" in arrays:
        steps = np.diff(np.asarray(arrays["times"], np.float64).ravel())
        rate = 1.0 / np.median(steps, keepdims=True) if (steps > 0).all() else np.zeros(1)
    else:
        return None
    if len(rate) != 1 or not (np.isfinite(rate[0]) and rate[0] > 0):
        raise DataFormatError("`rate` must be one number above 0, and `times` must rise [s]", path)
    return float(rate[0])


def sign_of(arrays: Mapping[str, NDArray[Any]], path: Path) -> int:
    """1, or -1 where the array `sign` says that harder presses read lower.

    Raises
    ------
    DataFormatError
        Another sign.
    """
    sign = np.asarray(arrays.get("sign", 1)).ravel().tolist()
    if sign not in ([1], [-1]):
        raise DataFormatError(f"`sign` must be 1 or -1, got {str(sign)[:60]}", path)
    return int(sign[0])


def _need(arrays: Mapping[str, NDArray[Any]], names: tuple[str, ...], path: Path) -> None:
    """Refuse arrays that lack some."""
    lacks = [name for name in names if name not in arrays]
    if lacks:
        raise DataFormatError(
            f"lacks {', '.join(lacks)}; the arrays are: {', '.join(arrays) or 'none'}", path
        )


def write_mounts(mounts: dict[str, Any], tables: Mapping[str, Placed], folder: Path) -> list[str]:
    """Write mounts.json and tables of taxels by their names; the files' names.

    `mounts` holds T_link_patch [m] and what belongs to them, which are kept with full digits.
    """
    kept = {"format": "skinmap-mounts-1", **mounts}
    text = json.dumps(kept, indent=2, allow_nan=False, default=np.ndarray.tolist)
    (folder / "mounts.json").write_text(text + "\n", encoding="utf-8")
    written = [write_taxels(*placed, folder / f"{name}.csv") for name, placed in tables.items()]
    return ["mounts.json", *written]


EXPECTED = "presses on a flat surface (.npz, or a recording .mcap)"
SLACK = np.deg2rad(5.0)  # beyond a joint's limits: what calibrated zeros and flexible stops explain
THRESHOLD = 8.0  # counts above its rest from which a channel of a recording is active


@dataclass(frozen=True, eq=False, slots=True)
class PlaneEvidence:
    """Presses, and the joints that their angles belong to."""

    joints: tuple[str, ...]
    contacts: PlaneContacts


def read_plane_evidence(
    paths: Sequence[Path], robot: Robot, parts: Sequence[str] = ()
) -> PlaneEvidence:
    """Presses of all files, of some parts or of all that they speak of.

    Parameters
    ----------
    paths : sequence of Path
    robot : Robot
        Its joints, and the channels of its parts.
    parts : sequence of str
        Parts to calibrate; every file must speak of them. All that the files share by default.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, one that does not follow its format, or whose angles are not the robot's:
        names what came and what was expected.
    UnknownNameError
        A joint or part that the robot lacks.
    """
    read = [_read(path, robot, parts) for path in paths]
    joints, every = read[0].joints, list[PlaneContacts]()
    for path, one in zip(paths, read, strict=True):
        if set(one.joints) != set(joints):
            raise DataFormatError(
                f"its joints are {', '.join(one.joints)}; those of {paths[0].name} "
                f"{', '.join(joints)}",
                path,
            )
        given = one.contacts
        if set(given.active) != set(read[0].contacts.active):
            raise DataFormatError(
                f"speaks of {', '.join(given.active)}; {paths[0].name} of "
                f"{', '.join(read[0].contacts.active)}: choose with --part",
                path,
            )
        columns = [one.joints.index(joint) for joint in joints]
        every.append(replace(given, angles=given.angles[:, columns]))
    return PlaneEvidence(joints, reduce(PlaneContacts.joined, every))


def _read(path: Path, robot: Robot, parts: Sequence[str]) -> PlaneEvidence:
    for part in parts:
        robot.part(part)
    try:
        if path.suffix.lower() == ".mcap":
            found = _from_recording(path, robot, parts)
        else:
            found = _from_arrays(path, robot, parts)
        _check_angles(found, robot)
    except InvalidArrayError as error:
        raise DataFormatError(str(error), path) from error
    return found


def _from_arrays(path: Path, robot: Robot, parts: Sequence[str]) -> PlaneEvidence:
    arrays = read_arrays(path, EXPECTED)
    for name in ("joints", "angles"):
        if name not in arrays:
            raise DataFormatError(
                f"lacks {name!r}; the arrays are: {', '.join(arrays) or 'none'}", path
            )
    joints = _names(arrays["joints"], robot)
    angles = check_finite(arrays["angles"], "angles", (None, len(joints)))
    found = [name.split("_", 1)[1] for name in arrays if name.startswith(("active_", "ids_"))]
    if not found:
        raise DataFormatError(
            f"lacks active_PART or ids_PART with ptr_PART; the arrays are: {', '.join(arrays)}",
            path,
        )
    for part in found:
        robot.part(part)
    for part in parts:
        if part not in found:
            raise DataFormatError(
                f"does not speak of {part!r}; the parts are: {', '.join(found)}", path
            )
    active = {
        part: _active(arrays, part, len(angles), robot.skin(part)) for part in (parts or found)
    }
    surface = check_whole(arrays.get("surface", np.zeros(len(angles), np.int64)), "surface")
    return PlaneEvidence(joints, PlaneContacts(angles, active, surface))


def _names(given: NDArray[Any], robot: Robot) -> tuple[str, ...]:
    if given.ndim != 1 or given.dtype.kind != "U":
        raise InvalidArrayError(f"joints must be names, got {given.dtype} {given.shape}")
    names = tuple(str(name) for name in given)
    joint_columns(robot, names)
    return names


def _active(arrays: Mapping[str, NDArray[Any]], part: str, m: int, skin: Skin) -> BoolArray:
    """(m, n) which taxels of a part were active."""
    keys = skin.channels
    if f"active_{part}" in arrays:
        given = np.asarray(arrays[f"active_{part}"])
        if given.dtype.kind not in "biu" or given.ndim != 2 or len(given) != m:
            raise InvalidArrayError(
                f"active_{part} must be true or false of shape ({m}, channels), "
                f"got {given.dtype} {given.shape}"
            )
        if given.dtype != np.bool_ and not np.isin(given, (0, 1)).all():
            raise InvalidArrayError(f"active_{part} must be true or false, got {given.max()}")
        return _of_taxels(np.asarray(given != 0), skin, f"active_{part}")
    presses = active_by_event(arrays, part, m)
    ids, press = np.concatenate(presses), np.repeat(np.arange(m), [*map(len, presses)])
    order = np.argsort(keys)
    place = np.minimum(np.searchsorted(keys[order], ids), len(keys) - 1)
    wrong = keys[order][place] != ids
    if wrong.any():
        first = int(np.argmax(wrong))
        raise InvalidArrayError(
            f"ids_{part}, press {press[first]}: channel {ids[first]} is not a taxel of {part}, "
            f"which has {len(keys)} channels between {keys.min()} and {keys.max()}"
        )
    active = np.zeros((m, len(keys)), np.bool_)
    active[press, order[place]] = True
    return active


def _check_angles(found: PlaneEvidence, robot: Robot) -> None:
    """Refuse angles beyond the joints' limits; degrees are recognised."""
    limits = np.array([robot.body.joints[joint] for joint in found.joints]).reshape(-1, 2)
    angles = found.contacts.angles
    beyond = (angles < limits[:, 0] - SLACK) | (angles > limits[:, 1] + SLACK)
    if not beyond.any():
        return
    press, column = np.argwhere(beyond)[0]
    joint, value = found.joints[column], angles[press, column]
    low, high = limits[column]
    sliding = np.array([joint in robot.body.sliding_joints for joint in found.joints])
    small = np.where(sliding, angles, np.deg2rad(angles))
    inside = (small >= limits[:, 0] - SLACK) & (small <= limits[:, 1] + SLACK)
    if inside.all() and (np.abs(angles[:, ~sliding]) > 2.0 * np.pi).any():
        raise InvalidArrayError(
            f"the angles look like degrees ({joint} at press {press} is {value:.4g}, its limits "
            f"are {low:.4g} to {high:.4g} rad): multiply them by pi / 180"
        )
    unit = "m" if joint in robot.body.sliding_joints else "rad"
    turned = -angles[:, column]
    fits = ((turned >= low - SLACK) & (turned <= high + SLACK)).all()
    raise InvalidArrayError(
        f"{joint} at press {press} is {value:.4g} {unit}, its limits are {low:.4g} to {high:.4g} "
        f"{unit}" + ("; with the sign turned all its angles fit" if fits else "")
    )


def _from_recording(path: Path, robot: Robot, parts: Sequence[str]) -> PlaneEvidence:
    from skinmap.io.mcap.reading import read_track
    from skinmap.io.recordings.recorded_stream import warn_of_loss

    track = warn_of_loss(read_track(path), path)
    if not track.joints:
        raise DataFormatError(
            "holds no joint angles; record them with it, or give an .npz of presses", path
        )
    joints = _names(np.array(track.joints), robot)
    wanted = tuple(parts) or tuple(name for name in track.parts if name in robot.part_specs)
    check_known(f"part in {path}", wanted, track.parts)
    values = np.asarray(track.values[0 : len(track.times)], np.float64)
    active = {}
    for part in wanted:
        own = values[:, track.columns(part)]
        rest = np.median(own, axis=0) if track.kind == "raw" else 0.0
        active[part] = _of_taxels(own - rest > THRESHOLD, robot.skin(part), part)
    rows = _presses(track, np.sum([one.sum(axis=1) for one in active.values()], axis=0))
    if len(rows) == 0:
        raise DataFormatError(f"no channel reads {THRESHOLD:g} counts above its rest", path)
    angles = track.angles[rows]
    missing = ~np.isfinite(angles).all(axis=1)
    if missing.any():
        time = track.times[rows[int(np.argmax(missing))]]
        raise DataFormatError(f"the press at {time:.2f} s has no joint angles", path)
    felt = {part: one[rows] for part, one in active.items()}
    return PlaneEvidence(joints, PlaneContacts(angles, felt))


def _of_taxels(active: BoolArray, skin: Skin, what: str) -> BoolArray:
    """Columns as taxels: in dense order, or the live vector."""
    if active.shape[1] == len(skin):
        return active
    if active.shape[1] <= skin.channels.max():
        raise InvalidArrayError(
            f"{what} has {active.shape[1]} columns, expected {len(skin)} taxels or a live vector "
            f"that reaches channel {skin.channels.max()}"
        )
    return active[:, skin.channels]


def _presses(track: RecordedStream, count: FloatArray | IntArray) -> IntArray:
    """The sample of most active taxels in each press: marked touches, or runs of activity."""
    if track.touches:
        spans = [np.arange(touch.first, touch.last + 1) for touch in track.touches]
    else:
        rows = np.flatnonzero(count > 0)
        spans = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    best = {int(span[np.argmax(count[span])]) for span in spans if len(span)}
    return np.array(sorted(row for row in best if count[row] > 0), np.int64)
