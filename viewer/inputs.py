"""What a user names on the command line, read and checked: pose, calibrations, responses, model."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calibration.response.response_file import load_response
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, InvalidArrayError, SkinMismatchError, UnknownNameError
from skinmap.io.taxels.readers import read_taxels
from skinmap.io.taxels.table import COLUMNS, COVARIANCE
from skinmap.io.text import read_text
from skinmap.skin.fingerprint import fingerprint
from skinmap.skin.robot import Robot
from viewer.layers import AUTO, Range, check_layer

SIZES = (160, 8000)  # of a picture [px]
# Place of each covariance column in the matrix.
ENTRIES = dict(zip(COVARIANCE, ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), strict=True))


def parse_pose(text: str | None, robot: Robot) -> dict[str, float]:
    """Joint angles [rad] from "joint=deg,joint=deg"; checked against the body's joints.

    Raises
    ------
    InvalidArrayError, UnknownNameError
        No number, a joint that the body lacks, or an angle beyond its limits.
    """
    angles: dict[str, float] = {}
    for item in (text or "").split(","):
        if not item.strip():
            continue
        joint, _, number = (word.strip() for word in item.partition("="))
        try:
            degrees = float(number)
        except ValueError:
            raise InvalidArrayError(f"pose: expected joint=degrees, got {item.strip()!r}") from None
        limits = robot.body.joints
        if joint not in limits:
            raise UnknownNameError("joint", joint, limits)
        low, high = (math.degrees(limit) for limit in limits[joint])
        if not low <= degrees <= high:  # false for NaN
            raise InvalidArrayError(
                f"pose: {joint} = {degrees:g} degrees is out of its range {low:.0f} to {high:.0f}"
            )
        angles[joint] = math.radians(degrees)
    return angles


def parse_size(text: str | None) -> tuple[int, int] | None:
    """Width and height [px] from "WxH".

    Raises
    ------
    InvalidArrayError
        No such text, or a size that cannot be drawn.
    """
    if text is None:
        return None
    width, _, height = text.lower().partition("x")
    try:
        size = int(width), int(height)
    except ValueError:
        raise InvalidArrayError(f"--size: expected WxH, as 1200x800, got {text!r}") from None
    if not all(SIZES[0] <= side <= SIZES[1] for side in size):
        raise InvalidArrayError(f"--size: sides from {SIZES[0]} to {SIZES[1]} pixels, got {text!r}")
    return size


def parse_ranges(texts: Sequence[str], shown: str) -> dict[str, Range]:
    """Limits by layer from "LOW:HIGH", "auto", or either with "LAYER=" before it.

    Raises
    ------
    InvalidArrayError, UnknownNameError
        No range, or no such layer.
    """
    found: dict[str, Range] = {}
    for text in texts:
        name, equals, limits = text.partition("=")
        if not equals:
            name, limits = shown, text
        check_layer(name)
        low, _, high = limits.partition(":")
        try:
            found[name] = AUTO if limits == AUTO else (float(low), float(high))
        except ValueError:
            raise InvalidArrayError(f"--range: expected LOW:HIGH or auto, got {limits!r}") from None
        if found[name] != AUTO and not -math.inf < float(low) < float(high) < math.inf:
            raise InvalidArrayError(f"--range: LOW must be below HIGH, got {limits!r}")
    return found


def read_covariances(
    names: Sequence[str], robot: Robot, parts: Sequence[str]
) -> dict[str, FloatArray]:
    """Covariances (n, 3, 3) [m2] by part from calibrated tables, each "FILE" or "PART=FILE".

    Taxels that a table leaves out, or leaves without a covariance, have NaN.

    Raises
    ------
    DataFormatError, SkinMismatchError
        A table without covariances, or of other taxels than the part's.
    """
    found = {}
    for name in names:
        part, path = _named(name, robot)
        channels, covariances = _covariances(path)
        part = part or _owner(channels, robot, parts, path)
        found[part] = _in_order(channels, covariances, robot.skin(part).channels, path, part)
    return found


def read_responses(names: Sequence[str], robot: Robot, parts: Sequence[str]) -> dict[str, Any]:
    """Response calibrations by part from files, each "FILE" or "PART=FILE".

    Raises
    ------
    DataFormatError, SkinMismatchError
        Not a response calibration, or one of another skin.
    """
    found = {}
    for name in names:
        part, path = _named(name, robot)
        response = load_response(path)
        if not part:
            known = response.fingerprint
            part = next((one for one in robot.parts if fingerprint(robot.skin(one)) == known), "")
        if not part and not response.fingerprint and len(parts) == 1:
            part = parts[0]
        if not part:
            raise SkinMismatchError(
                f"{path}: calibrated was no part of {robot.name!r} that could be recognised; "
                "name it: PART=FILE"
            )
        skin = robot.skin(part)
        load_response(path, fingerprint=fingerprint(skin) if response.fingerprint else "")
        if len(response.health) != len(robot.skin(part)):
            raise SkinMismatchError(
                f"{path}: {len(response.health)} taxels, {part!r} has {len(robot.skin(part))}"
            )
        found[part] = response
    return found


def _named(name: str, robot: Robot) -> tuple[str, Path]:
    """Part and path of "PART=FILE"; no part in "FILE"."""
    part, equals, path = name.partition("=")
    if not equals or Path(name).is_file():
        return "", Path(name)
    robot.part(part)
    return part, Path(path)


def _covariances(path: Path) -> tuple[np.ndarray, FloatArray]:
    """Channels (n,) and covariances (n, 3, 3) [m2] of a calibrated table."""
    read_taxels(path, "csv")  # checks header and numbers
    rows = [row for row in csv.reader(read_text(path).splitlines()) if row]
    names = tuple(cell.strip() for cell in rows[0])
    if names != (*COLUMNS, *COVARIANCE):
        raise DataFormatError(
            f"no covariances: a calibrated table has the columns {','.join(COVARIANCE)} too",
            path,
            1,
        )
    numbers = np.array([[float(cell) for cell in row] for row in rows[1:]])
    matrices = np.zeros((len(numbers), 3, 3))
    for column, (i, j) in zip(numbers[:, len(COLUMNS) :].T, ENTRIES.values(), strict=True):
        matrices[:, i, j] = matrices[:, j, i] = column
    known = np.isfinite(matrices).all(axis=(1, 2))
    unknown = np.isnan(matrices).all(axis=(1, 2))
    if not (known | unknown).all() or (np.linalg.eigvalsh(matrices[known])[:, 0] < -1e-12).any():
        raise DataFormatError("not a valid covariance: not finite, or negative", path)
    return numbers[:, 0].astype(np.int64), matrices


def _in_order(
    channels: IntArray, covariances: FloatArray, wanted: IntArray, path: Path, part: str
) -> FloatArray:
    """Covariances in the order of a part's channels."""
    rows = {int(channel): row for row, channel in enumerate(channels)}
    strange = sorted(set(rows) - set(map(int, wanted)))
    if strange:
        raise SkinMismatchError(
            f"{path}: channel {strange[0]} is none of the {len(wanted)} taxels of {part!r}"
        )
    ordered = np.full((len(wanted), 3, 3), np.nan)
    known = [row for row, channel in enumerate(wanted) if int(channel) in rows]
    ordered[known] = covariances[[rows[int(wanted[row])] for row in known]]
    return ordered


def _owner(channels: np.ndarray, robot: Robot, parts: Sequence[str], path: Path) -> str:
    """The only part whose taxels are these; where none has just these, the only one with them."""
    mine = set(channels.tolist())
    owned = {part: set(robot.skin(part).channels.tolist()) for part in parts}
    fitting = [part for part in parts if mine == owned[part]]
    fitting = fitting or [part for part in parts if mine <= owned[part]]
    if len(fitting) == 1:
        return fitting[0]
    why = f"fits {', '.join(fitting)}" if fitting else "fits no part that is shown"
    raise SkinMismatchError(f"{path}: a table of {len(mine)} taxels {why}; name it: PART=FILE")
