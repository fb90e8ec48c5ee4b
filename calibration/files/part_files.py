"""Parts of a robot without a URDF: chains from rows of Denavit and Hartenberg, beside recordings.

`part_NAME.npz` of each chain with taxels holds `taxel_pos (n, 3)` [m] (NaN where an id has no
taxel), `mount (6,)` (translation [m], rotation vector [rad]), `dh (k, 4)` (a, d, alpha, offset) and
`joint_cols`, the columns of the recordings' angles. A probe has such a file of its own, or sits on
the part that a file of probes names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.files.mount_files import read_arrays
from calibration.files.probe_file import BESIDE, Probe
from calibration.files.self_touch_files import (
    PART,
    SelfTouchData,
    find_probes,
    read_touches,
    touch_files,
)
from calibration.mount.chains import Chain
from skinmap.arrays import FloatArray, check_finite, check_whole
from skinmap.errors import DataFormatError, MissingFileError
from skinmap.skin.normals import NEIGHBOURS, patch_labels, repair_normals

NOTHING = np.zeros((0, 3))


def load_part_touches(paths: Sequence[Path], probe_file: Path | None = None) -> SelfTouchData:
    """Recordings from files, or all of a folder, with the parts that lie beside them.

    Raises
    ------
    MissingFileError, DataFormatError
        A file that does not exist, or does not follow the format (names what it lacks).
    """
    files = touch_files(paths)
    probes = find_probes(probe_file, files)
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
        f"no taxels of {name!r}, and its link is unknown; name it in {BESIDE} beside it or "
        f'with --probes FILE: [[probe]] name = "{name}", part = one of: '
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
        mount = np.eye(4)
        placed = check_finite(arrays["mount"], "mount", (6,))
        mount[:3, 3] = placed[:3]
        mount[:3, :3] = Rotation.from_rotvec(placed[3:]).as_matrix()
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
