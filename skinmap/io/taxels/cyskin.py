"""CySkin files (JSON, version 2): a skin with its triangles, and flat maps of it.

    {"info": {"file_version": "2", "type": ..., "name": ...},
     "skin": {"n_taxels": n, "n_faces": m,
              "parent_frames": [{"key", "id", "type", "name", "tf_matrix": 16, by columns}],
              "taxels": [{"id", "x": [x, y, z], "n": [nx, ny, nz], "type", "cut"}],
              "faces": [[i, j, k]]},
     "tactile_maps": [{"key", "name", "type", "taxels": [{"id", "x": [x, y]}], "faces"}]}

Metres. A file may hold a skin alone or maps alone; maps may also be a dict. A map matches its skin
by row. The id of a taxel is 16 times its module and its slot there; two taxels cannot share one:
they have a place and no channel. What else is doubtful in a file is said in words, and nothing is
changed for it.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from scipy.spatial import cKDTree

from skinmap.arrays import BoolArray, FloatArray, IntArray, check_finite, freeze
from skinmap.errors import DataFormatError, InvalidArrayError, InvalidMeshError
from skinmap.geometry.topology import check_surface
from skinmap.geometry.triangles import cross_products, signed_areas, unit
from skinmap.io.text import MAX_CHANNEL, in_file, read_text
from skinmap.skin.skin import skin_from_table
from skinmap.skin.taxels import NO_ID, TaxelTable
from skinmap.surface.surface_mesh import SurfaceMesh, build_surface
from skinmap.validation import checked

VERSION = "2"
SLOTS = 16  # ids of a module
ALONE = 4  # a module of one taxel where most have so many is a number that stands for none
MAX_REAL = 1e6  # of places [m] and normals: their squares are numbers too
PLACEHOLDERS = ("", "tbd", "todo", "none", "unknown")  # names of frames that name no link

Real = Annotated[float, msgspec.Meta(ge=-MAX_REAL, le=MAX_REAL)]
Place = Annotated[list[Real], msgspec.Meta(min_length=3, max_length=3)]
Spot = Annotated[list[Real], msgspec.Meta(min_length=2, max_length=3)]  # on a map; a third is zero
Corners = Annotated[list[int], msgspec.Meta(min_length=3, max_length=3)]
Number = Annotated[int, msgspec.Meta(ge=-MAX_CHANNEL, le=MAX_CHANNEL)]


class _Info(msgspec.Struct):
    """`info`."""

    file_version: str | int
    type: str = ""
    name: str = ""
    application: Any = ""
    description: Any = ""


class _Frame(msgspec.Struct, kw_only=True):
    """One of `parent_frames`."""

    key: Any = 0
    id: Any = 0
    type: str = ""
    name: str = ""
    tf_matrix: Annotated[list[float], msgspec.Meta(min_length=16, max_length=16)]


class _Taxel(msgspec.Struct):
    """One of `taxels` of the skin."""

    id: Number
    x: Place
    n: Place = msgspec.field(default_factory=lambda: [0.0, 0.0, 0.0])
    type: Any = "pressure"
    cut: Any = 0


class _Spot(msgspec.Struct, kw_only=True):
    """One of `taxels` of a map."""

    id: Number = NO_ID
    x: Spot
    type: Any = "pressure"
    cut: Any = 0


class _Skin(msgspec.Struct, kw_only=True):
    """`skin`."""

    n_taxels: int | None = None
    n_faces: int | None = None
    parent_frames: list[_Frame] = msgspec.field(default_factory=list)
    taxels: Annotated[list[_Taxel], msgspec.Meta(min_length=1)]
    faces: list[Corners] = msgspec.field(default_factory=list)


class _Map(msgspec.Struct, kw_only=True):
    """One of `tactile_maps`."""

    key: Any = None
    name: str = ""
    type: str = ""
    description: Any = ()
    n_taxels: int | None = None
    n_faces: int | None = None
    taxels: list[_Spot]
    faces: list[Corners] = msgspec.field(default_factory=list)


class _File(msgspec.Struct, omit_defaults=True):
    """A whole file."""

    info: _Info
    skin: _Skin | None = None
    tactile_maps: list[_Map] | dict[str, _Map] | None = None


@dataclass(frozen=True, eq=False, slots=True)
class TactileMap:
    """A flat map of a skin, row by row as the skin has its taxels.

    Attributes
    ----------
    name, kind : str
        `isomap`, `flat_mesh` or `flat_sensors_placement` are the kinds that are known.
    ids : (n,) int
    uv : (n, 2) float
        [m].
    faces : (m, 3) int
        Rows.
    key : str
    stated : tuple of int or None
        `n_taxels` and `n_faces`.
    """

    name: str
    kind: str
    ids: IntArray
    uv: FloatArray
    faces: IntArray
    key: str = ""
    stated: tuple[int | None, int | None] = (None, None)

    def __post_init__(self) -> None:
        uv = check_finite(self.uv, "uv", (None, 2))
        freeze(self, ids=_whole(self.ids, (len(uv),)), uv=uv, faces=_whole(self.faces, (-1, 3)))


@dataclass(frozen=True, eq=False, slots=True)
class ParentFrame:
    """What a file says of the frame that the skin is mounted to: mostly nothing.

    Attributes
    ----------
    name : str
    transform : (4, 4) float
        As written, whether it is a rigid motion or not.
    """

    name: str
    transform: FloatArray

    @property
    def placeholder(self) -> bool:
        """Whether it names no link."""
        return self.name.strip().lower() in PLACEHOLDERS


@dataclass(frozen=True, eq=False, slots=True)
class CySkin:
    """A CySkin file.

    Attributes
    ----------
    name : str
        `info.name`, which need not be true.
    ids : (n,) int
        Of the taxels, as the file has them; n is 0 where it holds maps only.
    positions, normals : (n, 3) float
        In the skin's own frame [m].
    faces : (m, 3) int
        Rows, counter-clockwise seen from outside where the file is right.
    maps : tuple of TactileMap
    frames : tuple of ParentFrame
    stated : tuple of int or None
        `n_taxels` and `n_faces` of the skin.
    """

    name: str
    ids: IntArray
    positions: FloatArray
    normals: FloatArray
    faces: IntArray
    maps: tuple[TactileMap, ...] = ()
    frames: tuple[ParentFrame, ...] = ()
    stated: tuple[int | None, int | None] = field(default=(None, None))

    def __post_init__(self) -> None:
        positions = check_finite(self.positions, "positions", (None, 3))
        freeze(
            self,
            ids=_whole(self.ids, (len(positions),)),
            positions=positions,
            normals=check_finite(self.normals, "normals", (len(positions), 3)),
            faces=_whole(self.faces, (-1, 3)),
        )

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def connected(self) -> BoolArray:
        """(n,) which taxels have a channel of their own (see `has_channel`)."""
        return has_channel(self.ids)

    def table(self) -> TaxelTable:
        """The taxels as a table: the channel is the row, the module the nearest that has room."""
        n = len(self)
        link = next((frame.name for frame in self.frames if not frame.placeholder), "")
        connected = self.connected
        return TaxelTable(
            np.arange(n),
            modules_of(self.ids, connected, self.positions),
            self.positions,
            self.normals,
            link=link,
            ids=np.where(connected, self.ids, NO_ID),
        )


def has_channel(ids: IntArray) -> BoolArray:
    """(n,) whether each id names one taxel alone.

    It does not where several taxels bear it, where it is negative, and where it is the only one
    of its module while modules have several: such numbers are written for taxels that are not
    wired.
    """
    _, row, count = np.unique(ids, return_inverse=True, return_counts=True)
    once = (count[row.ravel()] == 1) & (ids >= 0)
    if not once.any():
        return np.asarray(once)
    _, row, size = np.unique(ids[once] // SLOTS, return_inverse=True, return_counts=True)
    if np.median(size) >= ALONE:
        once[once] = size[row.ravel()] > 1
    return np.asarray(once)


def modules_of(ids: IntArray, connected: BoolArray, positions: FloatArray) -> IntArray:
    """(n,) module of each taxel; one without a channel goes to the nearest module with room."""
    modules = ids // SLOTS
    if connected.all() or not connected.any():
        return np.asarray(np.where(connected, modules, 0))
    names, row, size = np.unique(modules[connected], return_inverse=True, return_counts=True)
    centres = np.stack(
        [np.bincount(row.ravel(), positions[connected, axis]) / size for axis in range(3)], axis=1
    )
    room = size < size.max()
    choice, centres = (names[room], centres[room]) if room.any() else (names, centres)
    lost = ~connected
    modules[lost] = choice[cKDTree(centres).query(positions[lost])[1]]
    return np.asarray(modules)


def ids_of(table: TaxelTable) -> IntArray:
    """(n,) ids of a table: its own, else 16 times the number of the module and the place in it.

    Modules of more than 16 taxels, which no id has room for, go on in the next number.
    """
    if len(table.ids):
        return table.ids
    _, module, size = np.unique(table.modules, return_inverse=True, return_counts=True)
    module = module.ravel()
    numbers = np.cumsum([1, *(-(-size // SLOTS))])[:-1]  # from 1: ids 0 to 15 are placeholders
    order = np.argsort(module, kind="stable")
    place = np.empty(len(table), np.int64)
    place[order] = np.arange(len(table)) - np.repeat(np.cumsum(size) - size, size)
    return np.asarray(SLOTS * numbers[module] + place)


def read_cyskin(path: Path) -> CySkin:
    """Read a CySkin file; what is doubtful in it is kept (see `file_faults`).

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, no JSON, another version, a key or number that is wrong (says where), or
        neither a skin nor maps.
    """
    fail = partial(DataFormatError, path=path)
    text = read_text(path, "a CySkin file (.json)")
    try:
        document = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise fail(f"not JSON: {str(error)[:200]}") from None
    told = checked(document, _File, what="the file", fail=fail)
    if str(told.info.file_version).strip() != VERSION:
        raise fail(f"CySkin version {str(told.info.file_version)[:20]!r}; version 2 is read")
    maps = told.tactile_maps or []
    keyed = list(maps.items()) if isinstance(maps, Mapping) else [(None, one) for one in maps]
    if told.skin is None and not keyed:
        raise fail("neither a skin nor tactile maps in it")
    with in_file(path):
        return _skin(told.info.name, told.skin, tuple(_map(one, key) for key, one in keyed))


def read_cyskin_taxels(path: Path) -> TaxelTable:
    """The taxels of a CySkin file as a table: `read_cyskin(path).table()`.

    Raises
    ------
    DataFormatError
        As for `read_cyskin`, or a file of maps only.
    """
    found = read_cyskin(path)
    if len(found) == 0:
        raise DataFormatError("tactile maps only, no skin: its taxels have no place", path)
    with in_file(path):
        return found.table()


def _refuse_constant(word: str) -> float:
    raise ValueError(f"{word} is not a number")


def _skin(name: str, told: _Skin | None, maps: tuple[TactileMap, ...]) -> CySkin:
    told = told or _Skin(taxels=[])
    return CySkin(
        name,
        np.array([taxel.id for taxel in told.taxels], np.int64),
        np.array([taxel.x for taxel in told.taxels], float).reshape(-1, 3),
        np.array([taxel.n for taxel in told.taxels], float).reshape(-1, 3),
        _faces(told.faces, len(told.taxels), "skin"),
        maps,
        tuple(
            ParentFrame(frame.name, np.array(frame.tf_matrix, float).reshape(4, 4).T)
            for frame in told.parent_frames
        ),
        (told.n_taxels, told.n_faces),
    )


def _map(told: _Map, key: str | None) -> TactileMap:
    label = told.name or (key or "tactile map")
    return TactileMap(
        label,
        told.type,
        np.array([spot.id for spot in told.taxels], np.int64),
        np.array([spot.x[:2] for spot in told.taxels], float).reshape(-1, 2),
        _faces(told.faces, len(told.taxels), label),
        str(told.key if key is None else key),
        (told.n_taxels, told.n_faces),
    )


def _faces(rows: list[list[int]], count: int, of: str) -> IntArray:
    try:
        faces = np.array(rows, np.int64).reshape(-1, 3)
    except OverflowError:
        raise InvalidArrayError(f"a face of {of!r} names a row beyond all numbers") from None
    wrong = ((faces < 0) | (faces >= count)).any(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InvalidArrayError(
            f"face {row} of {of!r} names rows {faces[row].tolist()}; it has {count} taxels"
        )
    return faces


def _whole(values: Any, shape: tuple[int, ...]) -> IntArray:
    return np.asarray(values, np.int64).reshape(shape)


def write_cyskin(found: CySkin, path: Path) -> None:
    """Write a CySkin file so that reading it gives the same numbers back, bit by bit."""
    skin = _Skin(
        n_taxels=len(found),
        n_faces=len(found.faces),
        parent_frames=[
            _Frame(key=key, id=key, name=one.name, tf_matrix=one.transform.T.ravel().tolist())
            for key, one in enumerate(found.frames)
        ],
        taxels=[
            _Taxel(*one)
            for one in zip(
                found.ids.tolist(), found.positions.tolist(), found.normals.tolist(), strict=True
            )
        ],
        faces=found.faces.tolist(),
    )
    maps = [
        _Map(
            key=key,
            name=one.name,
            type=one.kind,
            n_taxels=len(one.ids),
            n_faces=len(one.faces),
            taxels=[
                _Spot(id=number, x=place)
                for number, place in zip(one.ids.tolist(), one.uv.tolist(), strict=True)
            ],
            faces=one.faces.tolist(),
        )
        for key, one in enumerate(found.maps)
    ]
    info = _Info(VERSION, "rigid_body", found.name)
    document = _File(info, skin if len(found) else None, maps)
    path.write_bytes(msgspec.json.encode(document) + b"\n")


def map_fits(found: CySkin, one: TactileMap) -> bool:
    """Whether a map can be of this skin: as many rows, and the ids or the triangles agree."""
    if len(one.ids) != len(found):
        return False
    same_ids = bool((one.ids == found.ids).mean() > 0.5)
    return same_ids or np.array_equal(one.faces, found.faces)


def columns_of(recorded: Sequence[int] | IntArray, table: TaxelTable) -> tuple[IntArray, ...]:
    """Columns of a recording by the taxels of a table, and what does not fit.

    Parameters
    ----------
    recorded : (k,) int
        Id of each recorded column.
    table : TaxelTable
        With ids.

    Returns
    -------
    columns : (n,) int
        Column of each taxel, -1 for one that was not recorded.
    unplaced : (u,) int
        Recorded ids that no taxel bears.
    twice : (t,) int
        Recorded ids that stand for several columns: they are no taxel's.
    """
    ids = np.asarray(recorded, np.int64)
    names, first, count = np.unique(ids, return_index=True, return_counts=True)
    once, twice = names[count == 1], names[count > 1]
    columns = np.full(len(table), -1, np.int64)
    row = np.minimum(np.searchsorted(once, table.ids), max(len(once) - 1, 0))
    known = (once[row] == table.ids) & (table.ids != NO_ID) if len(once) else np.zeros(0, bool)
    columns[known] = first[count == 1][row[known]]
    return columns, np.setdiff1d(once, table.ids), twice


def cyskin_surface(path: Path, meshing: str | None = None) -> SurfaceMesh:
    """The skin of a CySkin file with its own triangles, or with ours by a meshing method."""
    found, table = read_cyskin(path), read_cyskin_taxels(path)
    hint = found.normals if found.normals.any() else None
    skin = skin_from_table(table, None, path.stem, table.link, hint=hint)
    if meshing is not None:
        return build_surface(skin, method=meshing)
    try:
        return build_surface(skin, faces=found.faces)
    except InvalidMeshError as error:
        words = f"its faces are not a surface ({error}); --meshing consensus lays new ones"
        raise DataFormatError(words, path) from None


APART = 30.0  # normals and faces that disagree by more in the median are two surfaces [deg]
OFF = 60.0  # a single normal further off its faces than this is wrong [deg]
SAME = 1e-6  # places nearer than this are the same: files round to less [m]
RIGID = 1e-3  # of a rotation: matrices are written with four digits


def file_faults(found: CySkin, file: str = "") -> list[str]:
    """Every fault of one file, a sentence each; `file` is its name, which may contradict it."""
    faults = [*_name_faults(found, file), *_count_faults("the skin", found.stated, found)]
    if len(found):
        faults += [*_id_faults(found.ids), *_frame_faults(found), *_surface_faults(found)]
    keys = Counter(one.key for one in found.maps)
    faults += [f"{count} maps have the key {key}" for key, count in keys.items() if count > 1]
    for one in found.maps:
        faults += _map_faults(one, found)
    return faults


def set_faults(files: Mapping[str, CySkin]) -> dict[str, list[str]]:
    """Faults that several files together have, by file: one place for all, ids given twice."""
    faults: dict[str, list[str]] = {name: [] for name in files}
    skins = {name: found for name, found in files.items() if len(found)}
    for names in _alike(skins):
        for name in names:
            others = ", ".join(other for other in names if other != name)
            faults[name].append(f"stands at the same place as {others}")
    owners: dict[int, list[str]] = {}
    for name, found in skins.items():
        for number in found.ids[found.connected].tolist():
            owners.setdefault(number, []).append(name)
    shared = Counter(pair for own in owners.values() for pair in pairwise(own))
    for (name, other), count in shared.items():
        faults[other].append(f"{count} ids are also those of taxels of {name}")
    return faults


def _alike(skins: Mapping[str, CySkin]) -> Iterator[list[str]]:
    """Names of the files whose taxels stand at the same places, where there are several."""
    groups: list[list[str]] = []
    for name, found in skins.items():
        for group in groups:
            first = skins[group[0]].positions
            if first.shape == found.positions.shape and (
                np.abs(first - found.positions).max() < SAME
            ):
                group.append(name)
                break
        else:
            groups.append([name])
    return (group for group in groups if len(group) > 1)


def _id_faults(ids: IntArray) -> Iterator[str]:
    names, count = np.unique(ids, return_counts=True)
    for name, times in zip(names[count > 1].tolist(), count[count > 1].tolist(), strict=True):
        yield f"{times} taxels have the id {name}: they have a place and no channel"
    for name in ids[~has_channel(ids) & np.isin(ids, names[count == 1])].tolist():
        why = "is negative" if name < 0 else "is the only one of its module"
        yield f"the id {name} {why}: its taxel has a place and no channel"


def _frame_faults(found: CySkin) -> Iterator[str]:
    if not found.frames:
        yield "no parent frame: the place of the skin is missing"
    for frame in found.frames:
        if frame.placeholder:
            yield f"tf_matrix is a placeholder: its frame is called {frame.name!r}, no link"
        turn = frame.transform[:3, :3]
        last = frame.transform[3]
        if np.abs(turn @ turn.T - np.eye(3)).max() > RIGID or np.linalg.det(turn) < 0:
            yield f"tf_matrix of frame {frame.name!r} is not a rigid motion"
        elif np.abs(last - [0.0, 0.0, 0.0, 1.0]).max() > RIGID:
            yield f"tf_matrix of frame {frame.name!r} is not written by columns"


def _surface_faults(found: CySkin) -> Iterator[str]:
    faces, count = found.faces, len(found)
    if len(faces) == 0:
        yield "no faces: the skin has no surface of its own"
        return
    try:
        check_surface(faces)
    except InvalidMeshError as error:
        yield f"the faces are not a surface: {error}"
    alone = count - len(np.unique(faces))
    if alone:
        yield f"{alone} of {count} taxels are in no face"
    if not found.normals.any():
        yield "no normals: zeros"
        return
    off = normal_angles(found)
    middle = float(np.median(off))
    if middle > APART:
        yield f"the normals disagree with the faces by {middle:.0f} degrees in the median"
    elif (off > OFF).any():
        wrong = int((off > OFF).sum())
        yield f"{wrong} of {count} normals are more than {OFF:.0f} degrees off the faces"


def normal_angles(found: CySkin) -> FloatArray:
    """(k,) angle between the normal of each taxel in a face and its faces' [deg]."""
    cross = cross_products(found.positions, found.faces)
    own = np.zeros_like(found.positions)
    for corner in range(3):
        np.add.at(own, found.faces[:, corner], cross)
    used = np.unique(found.faces)
    cosine = np.einsum("ij,ij->i", unit(own[used]), unit(found.normals[used]))
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _map_faults(one: TactileMap, found: CySkin) -> Iterator[str]:
    yield from _count_faults(f"map {one.name!r}", one.stated, one)
    if len(found) == 0:
        return
    if not map_fits(found, one):
        yield f"map {one.name!r} is of another skin: {_difference(one, found)}"
        return
    wrong = int(((one.ids != found.ids) & (one.ids != NO_ID)).sum())
    if wrong:
        yield f"map {one.name!r} has other ids in {wrong} of {len(found)} rows: rows count"
    faces = one.faces if len(one.faces) else found.faces
    if len(faces):
        areas = signed_areas(one.uv, faces)
        over = int(min((areas < 0).sum(), (areas > 0).sum()))
        if over:
            yield f"map {one.name!r} turns {over} of {len(faces)} triangles over"


def _difference(one: TactileMap, found: CySkin) -> str:
    if len(one.ids) != len(found):
        return f"{len(one.ids)} taxels, the skin has {len(found)}"
    return "ids and faces both disagree"


def _count_faults(what: str, stated: Sequence[int | None], of: CySkin | TactileMap) -> list[str]:
    counts = zip(("taxels", "faces"), stated, (len(of.ids), len(of.faces)), strict=True)
    return [
        f"{what} is stated to have {said} {word} and has {have}"
        for word, said, have in counts
        if said is not None and said != have
    ]


def _name_faults(found: CySkin, file: str) -> Iterator[str]:
    """`info.name` against the names of the maps and of the file: UR10_link2 over link1's maps."""
    own = _numbered(found.name)
    witnesses = [_numbered(name) for name in (*(one.name for one in found.maps), file)]
    for word, number in own.items():
        said = {one[word] for one in witnesses if word in one}
        if said and number not in said:
            others = " and ".join(f"{word}{other}" for other in sorted(said))
            yield f"info.name is {found.name!r}; its maps or its file state {others}"


def _numbered(name: str) -> dict[str, str]:
    """Words of a name that end in a number: {"link": "1"}."""
    return dict(re.findall(r"([a-z]{3,})[_ -]?(\d+)", name.lower()))
