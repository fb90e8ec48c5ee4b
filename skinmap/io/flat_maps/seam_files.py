"""Where seams shall run: away from the touches of a recording, or along the paths of a file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import DataFormatError, InvalidArrayError, SkinMismatchError
from skinmap.flat.flat_map import FlatMap
from skinmap.flat.seams import path_along
from skinmap.geometry.topology import edges
from skinmap.io.recordings.touch_files import load_recordings
from skinmap.io.text import check_file, read_text
from skinmap.surface.surface_mesh import SurfaceMesh
from skinmap.touch.contacts.rest import felt
from skinmap.touch.contacts.skin_geometry import connected, padded_neighbours, pressed
from skinmap.touch.recording import Recording


def write_flat_obj(flat: FlatMap, path: Path) -> None:
    """OBJ of a part: taxels in their order, faces with the corners of the charts as vt."""
    start = np.cumsum([0, *(len(chart.taxels) for chart in flat.charts)])
    faces = np.concatenate([chart.taxels[chart.faces] for chart in flat.charts])
    corners = np.concatenate(
        [chart.faces + at for chart, at in zip(flat.charts, start, strict=False)]
    )
    uv = np.concatenate([chart.uv for chart in flat.charts])
    write_obj_with_uv(path, flat.mesh.vertices, faces, uv, corners)


def write_obj_with_uv(
    path: Path, vertices: FloatArray, faces: IntArray, uv: FloatArray, corners: IntArray
) -> None:
    """Write a Wavefront OBJ.

    Parameters
    ----------
    path : Path
    vertices : (n, 3) array of float
        In the order of the taxels [m].
    faces : (m, 3) array of int
        Over them.
    uv : (k, 2) array of float
        Texture coordinates, those of a seam doubled [m].
    corners : (m, 3) array of int
        Row of `uv` of each corner of each face.
    """
    lines = ["# metres; vt are flat-map coordinates in metres, vertices in the order of the taxels"]
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"vt {u!r} {v!r}" for u, v in uv.tolist()]
    pairs = np.stack([faces + 1, corners + 1], axis=2).reshape(-1, 6)
    lines += [f"f {a}/{b} {c}/{d} {e}/{f}" for a, b, c, d, e, f in pairs.tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


MAX_BYTES = 2**16  # of a file of channels: a seam passes some hundred taxels
MAX_CHANNEL = 10_000_000


def recorded_touches(path: Path, meshes: Mapping[str, SurfaceMesh]) -> dict[str, list[IntArray]]:
    """By part, the taxels (k,) of each touch of a recording.

    Raises
    ------
    SkinMismatchError
        None of the parts is recorded, or with another number of taxels.
    """
    recordings = load_recordings(path)
    own = {part: [r for r in recordings if r.part in (part, Path(part).stem)] for part in meshes}
    if len(meshes) == len(recordings) == 1:  # a mesh file and a recording are matched as they are
        own = dict.fromkeys(meshes, recordings)
    if not any(own.values()):
        recorded = ", ".join(sorted({r.part for r in recordings})) or "nothing"
        raise SkinMismatchError(f"{path} holds touches of {recorded}, not of {', '.join(meshes)}")
    found = {
        part: [touch for r in some for touch in _touches(r, meshes[part], path)]
        for part, some in own.items()
        if some
    }
    if not any(found.values()):
        raise SkinMismatchError(f"{path} holds no touch of {', '.join(found)}")
    return found


def _touches(recording: Recording, mesh: SurfaceMesh, path: Path) -> list[IntArray]:
    """Rows (k,) of the skin that each touch of a recording covers, one a connected piece."""
    columns, count = mesh.skin.channels, recording.pressures.shape[1]
    if mesh.skin.link or len(columns) == count:  # a robot's part: a column for each taxel
        columns = np.arange(len(columns))
    if (len(columns) != count and mesh.skin.link) or columns.max(initial=-1) >= count:
        raise SkinMismatchError(
            f"{path} has {count} channels of {recording.part!r}, the skin {mesh.skin.part!r} has "
            f"{len(mesh.skin)}"
        )
    pairs, rest = edges(mesh.faces), recording.rest()
    links = np.concatenate([pairs, pairs[:, ::-1]])
    beside = np.full((count, 1), count)
    if len(columns) == count:
        beside = padded_neighbours(pairs, count)
    found = []
    for _, _, samples in recording.touches():
        touched: BoolArray = np.any(felt(pressed(samples), rest, beside) > 0, axis=0)
        active = touched[columns]
        taxels = np.flatnonzero(active)
        piece = connected(links, active, taxels)
        found += [taxels[piece == k] for k in np.unique(piece)]
    return found


def read_cuts(path: Path, meshes: Mapping[str, SurfaceMesh]) -> dict[str, IntArray]:
    """By part, the edges (c, 2) of taxels that a file of channels cuts.

    Each line is a path: channels with blanks or commas between, joined by the shortest ways.

    Raises
    ------
    DataFormatError
        A line that is no list of channels, or of one channel alone.
    InvalidArrayError
        A channel that no part has, or a line whose channels lie in several parts or patches.
    """
    cuts: dict[str, list[IntArray]] = {part: [] for part in meshes}
    for number, stops in _lines(path):
        owner = [p for p, mesh in meshes.items() if np.isin(stops, mesh.skin.channels).all()]
        if not owner:
            known = np.concatenate([mesh.skin.channels for mesh in meshes.values()])
            lost = stops[~np.isin(stops, known)]
            said = f"no channel {lost[0]}" if len(lost) else "channels of several parts"
            raise InvalidArrayError(f"{path}, line {number}: {said} in {', '.join(meshes)}")
        mesh = meshes[owner[0]]
        order = np.argsort(mesh.skin.channels, kind="stable")
        rows = order[np.searchsorted(mesh.skin.channels[order], stops)]
        try:
            way = path_along(mesh.vertices, mesh.faces, mesh.representative[rows])
        except ValueError as error:
            raise InvalidArrayError(f"{path}, line {number}: {error}") from error
        cuts[owner[0]].append(way)
    none = np.zeros((0, 2), np.int64)
    return {part: np.concatenate([none, *ways]) for part, ways in cuts.items()}


def _lines(path: Path) -> Sequence[tuple[int, IntArray]]:
    """The paths of a file: number of the line, channels (k,)."""
    check_file(path, "a file of channels", MAX_BYTES)
    found = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        words = [word for word in re.split(r"[\s,]+", line.partition("#")[0]) if word]
        if not words:
            continue
        channels = [int(word) for word in words if re.fullmatch(r"\d{1,8}", word)]
        if len(channels) != len(words) or len(words) < 2 or max(channels) > MAX_CHANNEL:
            raise DataFormatError(
                f"expected two channels or more, as 3 8 20, got {line.strip()[:60]!r}",
                path,
                line=number,
            )
        found.append((number, np.array(channels, np.int64)))
    if not found:
        raise DataFormatError("no channel in it", path)
    return found
