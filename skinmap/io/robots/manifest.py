"""Robot manifests: which body, which parts, which taxel tables (schema in docs/manifest.md)."""

from __future__ import annotations

import importlib
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

import skinmap
from skinmap.arrays import FloatArray
from skinmap.errors import (
    DataFormatError,
    ForbiddenPathError,
    MissingFileError,
    UnknownNameError,
    check_kind,
    check_known,
)
from skinmap.geometry.rigid import rigid_transform, transform_directions, transform_points
from skinmap.geometry.triangles import TriangleMesh
from skinmap.io.robots.mesh_file import file_metres, read_mesh
from skinmap.io.robots.urdf import MeshBody, UrdfBody
from skinmap.io.taxels.cyskin import has_channel, modules_of
from skinmap.io.taxels.taxel_table import read_taxels
from skinmap.io.text import MAX_CHANNEL, UNITS, is_file, parse_whole, read_text, read_toml
from skinmap.skin.modules import module_layout
from skinmap.skin.robot import AUTO, Body, Part, Robot
from skinmap.skin.taxels import NO_ID, TaxelTable
from skinmap.validation import checked, toml_table

MODEL_PACKAGES = ("icub-models",)
MAX_DEGREES = 36_000  # a hundred turns
MAX_POSE_MM = 1e5  # a hundred metres: no part stands further from its link
MAX_COVER_MM = 1e3
Triple = tuple[float, float, float]


class _Robot(msgspec.Struct, forbid_unknown_fields=True):
    """The table `[robot]`."""

    name: str
    urdf: str | None = None
    mesh: str | None = None
    units: str = "m"
    pose_deg: dict[str, Any] = msgspec.field(default_factory=dict)


class _Pose(msgspec.Struct, forbid_unknown_fields=True):
    """A table `pose`: where a shape stands, turned about the fixed axes x, y, z and moved."""

    xyz_mm: Triple = (0.0, 0.0, 0.0)
    rpy_deg: Triple = (0.0, 0.0, 0.0)


class _Piece(msgspec.Struct, forbid_unknown_fields=True):
    """A table `[[part.piece]]`: a shape at its place, one of several that make a part."""

    taxels: str
    pose: _Pose | None = None
    ids: str | None = None


class _Part(msgspec.Struct, forbid_unknown_fields=True):
    """A table `[[part]]`."""

    name: str
    link: str
    taxels: str | None = None
    format: str | None = None
    units: str | None = None
    module: str | None = None
    drawing: str | None = None
    frame: str = AUTO
    pose: _Pose | None = None
    ids: str | None = None
    piece: list[_Piece] = msgspec.field(default_factory=list)
    ring: bool = False
    cover_mm: float = 0.0
    cover: str | None = None


class _Manifest(msgspec.Struct, forbid_unknown_fields=True):
    """A whole manifest."""

    robot: _Robot
    part: Annotated[list[_Part], msgspec.Meta(min_length=1)]


def data_folder() -> Path:
    """The folder of built-in data: inside the installed package, else beside it in a checkout."""
    package = Path(skinmap.__file__).resolve().parent
    return package / "data" if (package / "data").is_dir() else package.parent / "data"


def builtin_robots() -> tuple[str, ...]:
    """Names of the robots that ship with Skinmap."""
    return tuple(sorted(_builtin_manifests()))


def builtin_named(name: str) -> str | None:
    """The built-in robot that is called by a name such as "iCub"; None where there is none."""
    for builtin, path in _builtin_manifests().items() if name else ():
        if read_toml(path)["robot"]["name"] == name:
            return builtin
    return None


def _builtin_manifests() -> dict[str, Path]:
    """Manifest of each built-in robot; it is named like the robot, its folder like a package."""
    return {path.stem: path for path in data_folder().glob("*/*.toml")}


SHIPPED = " or the name of a robot (`skinmap list robots`)"
WRITE_ONE = ", as `skinmap new ROBOT.urdf --taxels FILE -o robot.toml` writes it,"


def load_robot(robot: str | Path, *, allow_outside: bool = False) -> Robot:
    """A robot by built-in name or by the path of its manifest; no part is read yet.

    Parameters
    ----------
    robot : str or Path
        "icub", "kaspar", "baxter-forearm", "ur10e-cyskin", or a manifest (.toml).
    allow_outside : bool
        Whether a manifest may read beyond its own folder and installed packages: one from a
        stranger must not open whatever it names.

    Returns
    -------
    Robot
        Its body, and the skins of its parts on demand.

    Raises
    ------
    UnknownNameError
        A name that is neither built in nor a file.
    DataFormatError, MissingFileError
        A manifest that is wrong, or names a file that does not exist.
    ForbiddenPathError
        A manifest that names a file outside its folder.

    Examples
    --------
    >>> import skinmap
    >>> skinmap.load_robot("baxter-forearm")
    Robot(name=Baxter forearm, parts=forearm, joints=1)
    """
    builtin = _builtin_manifests()
    if str(robot) in builtin:
        return replace(read_manifest(builtin[str(robot)]), origin=str(robot))
    path = Path(robot)
    if path.suffix == ".toml" or os.path.exists(path):  # False for a name that no file can have
        return read_manifest(path, allow_outside=allow_outside)
    raise UnknownNameError("robot", str(robot), sorted(builtin))


def read_manifest(path: Path, *, allow_outside: bool = False) -> Robot:
    """A robot from its manifest file; see `load_robot`."""
    try:
        document = read_toml(path, "a robot manifest (.toml)")
    except DataFormatError:
        written = path.suffix.lower() in (".urdf", ".xacro", ".csv")
        check_kind(path, "a manifest", hint=WRITE_ONE if written else SHIPPED)
        raise
    fail = partial(DataFormatError, path=path)
    told = checked(document, _Manifest, what="the manifest", fail=fail, called=toml_table)
    head, inside = told.robot, None if allow_outside else path.resolve().parent
    body = _body(head, path, inside)
    parts: dict[str, Part] = {}
    for entry in told.part:
        part = _part(entry, path, inside)
        if part.name in parts:
            raise DataFormatError(f"two parts are called {part.name!r}", path)
        if part.link not in body.links:
            raise UnknownNameError(f"link (part {part.name!r})", part.link, body.visible_links)
        parts[part.name] = part
    pose = _pose(head.pose_deg, body, path)
    return Robot(head.name, body, parts, pose, origin=str(path.resolve()))


def beside(manifest: Path, name: str, inside: Path | None, needed: str = "") -> Path:
    """The path of a file named in a manifest, which may not lead out of the folder `inside`.

    Raises
    ------
    MissingFileError
        It does not exist, where `needed` says what it must be.
    ForbiddenPathError
        It does, by `..`, an absolute path or a link.
    DataFormatError
        A name that no file can have.
    """
    if "\0" in name:
        raise DataFormatError(f"no file can be called {name!r}", manifest)
    path = manifest.parent / name
    if inside is not None and not path.resolve().is_relative_to(inside):
        raise ForbiddenPathError(
            f"{manifest} names {name!r}, outside its own folder; SKINMAP_ALLOW_OUTSIDE=1 allows it"
        )
    if needed and not is_file(path):
        raise MissingFileError(path, needed)
    return path


def _body(head: _Robot, path: Path, inside: Path | None) -> Body:
    """The URDF of a robot, or the one mesh of a single body."""
    if head.mesh is not None and head.urdf is None:
        return MeshBody(beside(path, head.mesh, inside), scale=_metres(head.units))
    if head.urdf is None or head.mesh is not None:
        raise DataFormatError("[robot] needs either 'urdf' or 'mesh'", path)
    if ":" in head.urdf:
        return UrdfBody(_package_model(head.urdf))
    return UrdfBody(beside(path, head.urdf, inside), inside=inside)


def _metres(unit: str) -> float:
    check_known("unit", [unit], UNITS)
    return UNITS[unit]


def _part(entry: _Part, path: Path, inside: Path | None) -> Part:
    layout = None
    if entry.module is not None:
        layout = module_layout(_layout_name(entry.module, path, inside))
    if not 0.0 <= entry.cover_mm <= MAX_COVER_MM:
        raise DataFormatError(
            f"part {entry.name!r}: cover_mm must be from 0 to {MAX_COVER_MM:g}, "
            f"got {entry.cover_mm:g}",
            path,
        )
    pieces = _pieces(entry, path)
    files = tuple(beside(path, piece.taxels, inside) for piece in pieces)
    return Part(
        entry.name,
        entry.link,
        _reader(pieces, files, entry.format, path, inside, _metres(entry.units or "m")),
        layout,
        entry.frame,
        None if entry.drawing is None else beside(path, entry.drawing, inside),
        maps=files if all(file.suffix.lower() == ".json" for file in files) else (),
        ring=entry.ring,
        cover=entry.cover_mm * 1e-3,
        cover_mesh=_cover(entry, path, inside),
        unit="inch" if entry.units == "in" else entry.units,
    )


def _pieces(entry: _Part, path: Path) -> list[_Piece]:
    """The tables of a part: its own one, or its pieces."""
    if entry.taxels is not None and not entry.piece:
        return [_Piece(entry.taxels, entry.pose, entry.ids)]
    if entry.taxels is None and entry.piece and entry.pose is None and entry.ids is None:
        return entry.piece
    raise DataFormatError(
        f"part {entry.name!r} needs either 'taxels' (with 'pose' and 'ids' where wanted) or "
        "[[part.piece]] tables that have them",
        path,
    )


def _cover(entry: _Part, path: Path, inside: Path | None) -> Callable[[], TriangleMesh] | None:
    """What reads the mesh of a part's cover, in the frame of its link [m]."""
    if entry.cover is None:
        return None
    if entry.cover_mm:
        raise DataFormatError(
            f"part {entry.name!r} has 'cover_mm' and 'cover': a distance or a mesh, not both", path
        )
    file = beside(path, entry.cover, inside, "a mesh of a cover")

    def read() -> TriangleMesh:
        vertices, faces = read_mesh(file)
        return TriangleMesh(vertices * (file_metres(file) or 1.0), faces)

    return read


def _layout_name(module: str, path: Path, inside: Path | None) -> str:
    """The name of a built-in layout, or the path of a file that exists."""
    if not module.endswith((".toml", ".csv")):
        return module
    return str(beside(path, module, inside, "a module layout"))


def _reader(
    pieces: Sequence[_Piece],
    files: Sequence[Path],
    format: str | None,
    path: Path,
    inside: Path | None,
    scale: float,
) -> Callable[[], TaxelTable]:
    """What reads a part: its tables, each at its place, one after the other."""
    numbers = [None if piece.ids is None else beside(path, piece.ids, inside) for piece in pieces]
    poses = [_transform(piece.pose, path) for piece in pieces]

    def read(metres: float = scale) -> TaxelTable:
        tables = []
        for file, T_link_piece, ids in zip(files, poses, numbers, strict=True):
            table = placed(read_taxels(file, format), metres, T_link_piece)
            tables.append(table if ids is None else with_ids(table, ids))
        return tables[0] if len(tables) == 1 else joined(tables)

    return read


def _transform(pose: _Pose | None, path: Path) -> FloatArray:
    """T_link_piece (4, 4) of a pose as the manifest writes it."""
    if pose is None:
        return np.eye(4)
    if not max(map(abs, pose.xyz_mm)) <= MAX_POSE_MM or not max(map(abs, pose.rpy_deg)) <= (
        MAX_DEGREES
    ):
        raise DataFormatError(
            f"a pose of {list(pose.xyz_mm)} mm and {list(pose.rpy_deg)} deg: "
            f"beyond {MAX_POSE_MM:g} mm or {MAX_DEGREES} deg",
            path,
        )
    turn = Rotation.from_euler("xyz", pose.rpy_deg, degrees=True).as_matrix()
    return rigid_transform(turn, np.asarray(pose.xyz_mm) * 1e-3)


def _pose(angles_deg: Mapping[str, object], body: Body, path: Path) -> dict[str, float]:
    pose = {}
    for joint, angle in angles_deg.items():
        check_known("joint", [joint], body.joints)
        number = isinstance(angle, int | float) and not isinstance(angle, bool)
        if not number or not abs(angle) <= MAX_DEGREES:  # type: ignore[arg-type]  # nor is NaN
            raise DataFormatError(f"pose_deg.{joint} must be a number, got {angle!r}", path)
        pose[joint] = math.radians(angle)  # type: ignore[arg-type]
    return pose


def _package_model(urdf: str) -> Path:
    """The URDF of `package:model`, a model of an installed package of robots."""
    package, _, model = urdf.partition(":")
    if package not in MODEL_PACKAGES:
        # Importing runs code: a manifest must not choose which.
        raise UnknownNameError("package of robot models", package, MODEL_PACKAGES)
    module = importlib.import_module(package.replace("-", "_"))
    if model not in module.get_robot_names():
        raise UnknownNameError(f"model in {package}", model, module.get_robot_names())
    return Path(module.get_model_file(model))


def placed(table: TaxelTable, scale: float, T_link_piece: FloatArray) -> TaxelTable:
    """A table in metres, carried to where its piece stands."""
    return replace(
        table,
        positions=transform_points(T_link_piece, table.positions * scale),
        normals=transform_directions(T_link_piece, table.normals),
    )


def with_ids(table: TaxelTable, path: Path) -> TaxelTable:
    """A table with the ids of a file, one whole number a taxel in the order of the channels.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, another number of ids, or something that is not a whole number.
    """
    ids: list[int] = []
    for line, text in enumerate(read_text(path).splitlines(), start=1):
        ids += parse_whole(text.split(), path, line, most=MAX_CHANNEL)
    if len(ids) != len(table):
        raise DataFormatError(f"{len(ids)} ids for {len(table)} taxels", path)
    numbers = np.array(ids, np.int64)
    wired = has_channel(numbers)
    # Copies of one shape are wired in different ways: the boards go by the ids, not by the shape.
    modules = modules_of(numbers, wired, table.positions)
    return replace(table, modules=modules, ids=np.where(wired, numbers, NO_ID))


def joined(tables: Sequence[TaxelTable]) -> TaxelTable:
    """One table of several pieces: channels and modules of each follow on those before it."""
    channel = module = 0
    channels, modules = [], []
    for table in tables:
        channels.append(table.channels + channel)
        modules.append(np.unique(table.modules, return_inverse=True)[1].ravel() + module)
        channel, module = int(channels[-1].max()) + 1, int(modules[-1].max()) + 1
    known = all(len(table.ids) for table in tables)
    return TaxelTable(
        np.concatenate(channels),
        np.concatenate(modules),
        np.concatenate([table.positions for table in tables]),
        np.concatenate([table.normals for table in tables]),
        np.concatenate([table.representative for table in tables]),
        tables[0].link,
        np.concatenate([table.ids for table in tables]) if known else np.zeros(0, np.int64),
        np.repeat(np.arange(len(tables)), [len(table) for table in tables]),
    )
