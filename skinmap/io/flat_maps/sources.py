"""What can be laid flat: parts of a robot, mesh files, CySkin files; and what others drew of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from skinmap.errors import DataFormatError, MissingFileError, UnknownNameError, warn
from skinmap.flat.mesh_charts import mesh_surface
from skinmap.io.flat_maps.drawing import Drawing, read_drawing
from skinmap.io.robots.mesh_file import read_mesh
from skinmap.io.taxels.cyskin import cyskin_surface, map_fits, read_cyskin
from skinmap.io.text import check_file
from skinmap.skin.robot import Robot
from skinmap.surface.surface_mesh import SurfaceMesh, build_surface

CYSKIN = ".json"
DRAWING, THEIRS = "drawing", "theirs"  # maps of others: drawn by hand, in the files of the skin


@dataclass(frozen=True, slots=True)
class Source:
    """One part: what makes its surface, and files with maps that others made of it."""

    surface: Callable[[], SurfaceMesh]
    drawing: Path | None = None
    theirs: Sequence[Path] = ()

    def others(self, names: Iterable[str], drawing: Path | None, taxels: int) -> dict[str, Drawing]:
        """The maps asked for, by their names; `drawing` instead of the part's own."""
        found: dict[str, Drawing] = {}
        path = drawing or (self.drawing if DRAWING in names else None)
        if path is not None and path.suffix.lower() == CYSKIN:
            found |= read_tactile_maps([path], taxels)
        elif path is not None:
            found[DRAWING] = read_drawing(path)
        if THEIRS in names and self.theirs:
            found |= read_tactile_maps(self.theirs)
        return found


def robot_sources(robot: Robot, parts: Iterable[str], meshing: str) -> dict[str, Source]:
    """Parts of a robot, meshed by a method."""

    def surface(part: str) -> SurfaceMesh:
        body = robot.mesh_under(part) if meshing == "accurate" else None
        return build_surface(robot.skin(part), method=meshing, body=body)

    return {
        part: Source(partial(surface, part), robot.part(part).drawing, robot.part(part).maps)
        for part in parts
    }


def file_sources(paths: Sequence[Path], meshing: str | None = None) -> dict[str, Source]:
    """Mesh files and CySkin files by their names, by their paths where two agree.

    Raises
    ------
    MissingFileError
        No such file.
    """

    def surface(path: Path) -> SurfaceMesh:
        return mesh_surface(*read_mesh(path, merge=False), name=path.name)

    found = []
    for path in paths:
        if path.suffix.lower() == CYSKIN:
            check_file(path, "a CySkin file")
            found.append((path.stem, Source(partial(cyskin_surface, path, meshing), None, [path])))
        elif path.is_file():
            found.append((path.name, Source(partial(surface, path))))
        else:
            raise MissingFileError(path, "a mesh file")
    names = [name for name, _ in found]
    return {
        name if names.count(name) == 1 else str(path): source
        for path, (name, source) in zip(paths, found, strict=True)
    }


def check_others(
    title: str, sources: Mapping[str, Source], names: Iterable[str], drawing: Path | None
) -> None:
    """Refuse maps of others where there are none, and warn where only some parts have one.

    Raises
    ------
    MissingFileError, UnknownNameError
        No drawing, no maps in the files.
    """
    if drawing is not None and not drawing.is_file():
        raise MissingFileError(drawing, "a drawing of iCubSkinGui (.ini) or CySkin maps (.json)")
    drawn = [part for part, one in sources.items() if one.drawing or drawing]
    theirs = [part for part, one in sources.items() if one.theirs]
    if DRAWING in names and not drawn:
        where = f"`drawing = ...` for a part in the manifest of {title}, or --compare drawing:FILE"
        raise MissingFileError("drawing", where)
    if THEIRS in names and not theirs:
        raise UnknownNameError(f"flat maps in the files of {title} (CySkin):", THEIRS, ())
    for name, what, some in ((DRAWING, "drawing", drawn), (THEIRS, "tactile map", theirs)):
        if name in names and (without := sorted({*sources} - {*some})):
            warn(f"no {what} of {', '.join(without)}")


def read_tactile_maps(paths: Sequence[Path], count: int | None = None) -> dict[str, Drawing]:
    """The maps of a part by their names, from the files of its pieces in their order.

    A map of another skin than its file's is left out with a `SkinWarning`.

    Parameters
    ----------
    paths : sequence of Path
        CySkin files; taxel i of a file is channel i after those of the files before it.
    count : int, optional
        Taxels of the part that the maps must be of; files may hold maps alone then.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, no CySkin file, or no map that fits the skin.
    """
    files = [read_cyskin(path) for path in paths]
    rows = [len(found) or count or 0 for found in files]
    if count is not None and sum(rows) != count:
        raise DataFormatError(f"maps of another skin: {sum(rows)} taxels, not {count}", paths[0])
    starts = np.cumsum([0, *rows])
    pieces: dict[str, list[Drawing]] = {}
    left = []
    for found, start, most in zip(files, starts.tolist(), rows, strict=False):
        for one in found.maps:
            fits = map_fits(found, one) if len(found) else len(one.ids) == most
            if not fits:
                left.append(f"{one.name!r} ({len(one.ids)} taxels, the skin has {most})")
                continue
            channels = np.arange(len(one.ids)) + start
            pieces.setdefault(one.name, []).append(Drawing(channels, one.ids, one.uv))
    if not pieces:
        why = f"only of another skin: {', '.join(left)}" if left else "a skin without tactile maps"
        raise DataFormatError(why, paths[0])
    if left:
        warn(f"left out maps of another skin: {', '.join(left)}")
    return {name: _joined(own) for name, own in pieces.items()}


def _joined(pieces: Sequence[Drawing]) -> Drawing:
    return Drawing(
        np.concatenate([one.channels for one in pieces]),
        np.concatenate([one.modules for one in pieces]),
        np.concatenate([one.xy for one in pieces]),
    )
