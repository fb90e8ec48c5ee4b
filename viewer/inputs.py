"""What a user names, read and checked: pose, ranges, calibrations, responses, an address."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from calibration.files.tables import ENTRIES
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import (
    DataFormatError,
    InvalidArrayError,
    SkinMismatchError,
    UnreachableError,
)
from skinmap.io.taxels.taxel_table import COLUMNS, COVARIANCE, read_taxels
from skinmap.io.text import csv_rows, read_text
from skinmap.skin.robot import Robot
from viewer.drawing.body.bare_body import posed
from viewer.layers import check_layer
from viewer.web.guard import LOOPBACK, check_token

TOKEN = "SKINMAP_TOKEN"  # in the environment: every user reads a command line
LAST_PORT = 65535


def checked_pose(degrees: Mapping[str, float], robot: Robot) -> dict[str, float]:
    """Joint angles [rad] of angles [deg] that the body's joints can take.

    Raises
    ------
    InvalidArrayError, UnknownNameError
        A joint that the body lacks, or an angle beyond its limits.
    """
    angles = {joint: math.radians(angle) for joint, angle in degrees.items()}
    posed(robot, angles)
    return angles


def checked_ranges(ranges: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """Limits by layer.

    Raises
    ------
    InvalidArrayError, UnknownNameError
        No range, or no such layer.
    """
    for name, limits in ranges.items():
        check_layer(name)
        if not -math.inf < limits[0] < limits[1] < math.inf:
            raise InvalidArrayError(f"ranges: the first of {list(limits)} must be below the second")
    return dict(ranges)


def parse_address(text: str) -> tuple[str, int]:
    """Host and port from "HOST:PORT" or "PORT"; port 0 is any that is free.

    Raises
    ------
    UnreachableError
        No such address; a robot's name for one, which stands before --web.
    """
    host, _, port = text.rpartition(":")
    if not port.isdigit():
        raise UnreachableError(f"--web takes PORT or HOST:PORT, got {text!r}: write it last")
    if int(port) > LAST_PORT:
        raise UnreachableError(f"--web: port {port} does not exist: ports are 0 to {LAST_PORT}")
    return host or LOOPBACK, int(port)


def read_token() -> str | None:
    """The token in the environment, or in the file named there by "@FILE"; None without.

    Raises
    ------
    MissingFileError, InvalidArrayError
        No such file, or a token that could be guessed.
    """
    text = os.environ.get(TOKEN)
    if text and text.startswith("@"):
        text = read_text(Path(text[1:])).strip()
    return check_token(text) if text else None


def is_load(name: str) -> bool:
    """Whether a calibration is one of loads: a folder or file of `skinmap calibrate load`."""
    path = Path(name.partition("=")[2] or name)
    return path.is_dir() or path.suffix.lower() == ".npz"


def are_checkups(name: str) -> bool:
    """Whether a calibration is a folder that `skinmap checkup --history` keeps."""
    path = Path(name.partition("=")[2] or name)
    return next(path.glob("checkup_*.json"), None) is not None


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
    rows = [row for _, row in csv_rows(read_text(path), path) if row]
    names = tuple(cell.strip() for cell in rows[0])
    if names != (*COLUMNS, *COVARIANCE):
        raise DataFormatError(
            f"no covariances: a calibrated table has the columns {','.join(COVARIANCE)} too",
            path,
            1,
        )
    try:
        numbers = np.array([[float(cell) for cell in row] for row in rows[1:]])
    except ValueError as error:
        raise DataFormatError(f"not a table of numbers: {error}", path) from None
    matrices = np.zeros((len(numbers), 3, 3))
    for column, (i, j) in zip(numbers[:, len(COLUMNS) :].T, ENTRIES, strict=True):
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
    strange = np.setdiff1d(channels, wanted)
    if len(strange):
        raise SkinMismatchError(
            f"{path}: channel {strange[0]} is not one of the {len(wanted)} taxels of {part!r}"
        )
    ordered = np.full((len(wanted), 3, 3), np.nan)
    order = np.argsort(wanted)
    ordered[order[np.searchsorted(wanted, channels, sorter=order)]] = covariances
    return ordered


def _owner(channels: np.ndarray, robot: Robot, parts: Sequence[str], path: Path) -> str:
    """The only part whose taxels are these; where none has just these, the only one with them."""
    mine = set(channels.tolist())
    owned = {part: set(robot.skin(part).channels.tolist()) for part in parts}
    fitting = [p for p in parts if mine == owned[p]] or [p for p in parts if mine <= owned[p]]
    if len(fitting) == 1:
        return fitting[0]
    why = f"fits {', '.join(fitting)}" if fitting else "fits no part that is shown"
    raise SkinMismatchError(f"{path}: a table of {len(mine)} taxels {why}; name it: PART=FILE")
