"""Files of self-touch: recordings of activated taxels and joint angles, and the parts they touch.

A recording `A_B.npz` holds `chain1`, `chain2` (names), `q (m, joints)` [rad] and, of each chain
with taxels, `ids_NAME` with `ptr_NAME (m + 1,)`: event i activated `ids[ptr[i]:ptr[i + 1]]`. Beside
it lies `part_NAME.npz` of each chain with taxels: `taxel_pos (n, 3)` [m] (NaN where an id has no
taxel), `mount (6,)` (translation [m], rotation vector [rad]), `dh (k, 4)` (a, d, alpha, offset) and
`joint_cols`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.mount.chains import Chain, TouchRecording
from skinmap.archive import open_arrays
from skinmap.arrays import FloatArray, IntArray, check_finite, check_whole
from skinmap.errors import DAMAGED_ARCHIVE, DataFormatError, InvalidArrayError, MissingFileError
from skinmap.skin.normals import NEIGHBOURS, patch_labels, repair_normals

PART = "part_"
NOTHING = np.zeros((0, 3))
PROBE = ("Finger", "Arm")  # a probe without a part of its own sits on the arm of its side


def load_self_touch(paths: Sequence[Path]) -> tuple[list[TouchRecording], dict[str, Chain]]:
    """Recordings from files, or all of a folder, and the chains that they name.

    Raises
    ------
    MissingFileError, DataFormatError
        A file that does not exist, or does not follow the format (names what it lacks).
    """
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            found = [file for file in sorted(path.glob("*.npz")) if not _is_part(file)]
            if not found:
                raise MissingFileError(path / "*.npz", "recordings of self-touch")
            files += found
        else:
            files.append(path)
    recordings, chains = [], dict[str, Chain]()
    for file in files:
        recording = _recording(file)
        recordings.append(recording)
        for name, touched in zip(recording.chains, recording.touched, strict=True):
            if name not in chains:
                probe = touched is None
                chains[name] = _probe(file.parent, name) if probe else _part(file.parent, name)
    return recordings, chains


def _is_part(file: Path) -> bool:
    return file.name.startswith(PART)


def _read(path: Path, expected: str) -> dict[str, FloatArray]:
    if not path.is_file():
        raise MissingFileError(path, expected)
    try:
        with open_arrays(path) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except DataFormatError:
        raise
    except DAMAGED_ARCHIVE as error:
        raise DataFormatError(f"not {expected}: {error}", path) from error


def _recording(path: Path) -> TouchRecording:
    arrays = _read(path, "a recording of self-touch")
    try:
        chains = (str(arrays["chain1"]), str(arrays["chain2"]))
        angles = check_finite(arrays["q"], "q", (None, None))
        touched = tuple(
            None if f"ids_{name}" not in arrays else _events(arrays, name, len(angles))
            for name in chains
        )
        return TouchRecording(path.stem, chains, angles, (touched[0], touched[1]))
    except KeyError as error:
        raise DataFormatError(f"a recording of self-touch lacks {error}", path) from error
    except InvalidArrayError as error:
        raise DataFormatError(str(error), path) from error


def _events(arrays: dict[str, FloatArray], name: str, m: int) -> list[IntArray]:
    ids = check_whole(arrays[f"ids_{name}"], f"ids_{name}")
    bounds = check_whole(arrays[f"ptr_{name}"], f"ptr_{name}")
    if bounds.shape != (m + 1,) or bounds[0] != 0 or bounds[-1] != len(ids):
        raise InvalidArrayError(
            f"ptr_{name} must rise from 0 to {len(ids)} in {m + 1} steps, got {bounds.shape}"
        )
    if (np.diff(bounds) < 0).any():
        raise InvalidArrayError(f"ptr_{name} falls at {int(np.argmax(np.diff(bounds) < 0))}")
    return np.split(ids, bounds[1:-1])


def _part(folder: Path, name: str) -> Chain:
    path = folder / f"{PART}{name}.npz"
    arrays = _read(path, f"the part that carries the taxels of {name!r}")
    try:
        mount = np.eye(4)
        placed = check_finite(arrays["mount"], "mount", (6,))
        mount[:3, 3] = placed[:3]
        mount[:3, :3] = Rotation.from_rotvec(placed[3:]).as_matrix()
        joints = check_whole(arrays["joint_cols"], "joint_cols")
        taxels = arrays["taxel_pos"]
        return Chain.from_dh(name, arrays["dh"], joints, mount, taxels, bulging_normals(taxels))
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
        return np.zeros((0, 3))
    labels = patch_labels(points)
    middles = np.stack([points[labels == label].mean(axis=0) for label in np.unique(labels)])
    normals[known] = repair_normals(points, None, points - middles[labels])
    return normals


def _probe(folder: Path, name: str) -> Chain:
    """A chain that ends in a tip: the joints of its own part, or of the arm that it sits on."""
    own = folder / f"{PART}{name}.npz"
    part = _part(folder, name if own.is_file() else name.replace(*PROBE))
    return replace(part, name=name, mount=np.eye(4), taxels=NOTHING, normals=NOTHING)
