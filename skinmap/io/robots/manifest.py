"""Robot manifests: which body, which parts, which taxel tables (schema in docs/manifest.md)."""

from __future__ import annotations

import importlib
import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import replace as replace_fields
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import msgspec

import skinmap
from skinmap.errors import (
    DataFormatError,
    ForbiddenPathError,
    MissingFileError,
    UnknownNameError,
)
from skinmap.io.robots.mesh_body import MeshBody
from skinmap.io.robots.urdf import UrdfBody
from skinmap.io.taxels.readers import read_taxels
from skinmap.io.text import is_file, read_text
from skinmap.io.units import UNITS
from skinmap.skin.layouts import module_layout
from skinmap.skin.repair import replace
from skinmap.skin.robot import AUTO, Body, Part, Robot
from skinmap.skin.taxels import TaxelTable
from skinmap.validation import checked, toml_table

MODEL_PACKAGES = ("icub-models",)
MAX_DEGREES = 36_000  # a hundred turns


class _Robot(msgspec.Struct, forbid_unknown_fields=True):
    """The table `[robot]`."""

    name: str
    urdf: str | None = None
    mesh: str | None = None
    units: str = "m"
    pose_deg: dict[str, Any] = msgspec.field(default_factory=dict)


class _Part(msgspec.Struct, forbid_unknown_fields=True):
    """A table `[[part]]`."""

    name: str
    link: str
    taxels: str
    format: str | None = None
    units: str = "m"
    module: str | None = None
    drawing: str | None = None
    frame: str = AUTO


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
        if tomllib.loads(read_text(path))["robot"]["name"] == name:
            return builtin
    return None


def _builtin_manifests() -> dict[str, Path]:
    """Manifest of each built-in robot; it is named like the robot, its folder like a package."""
    return {path.stem: path for path in data_folder().glob("*/*.toml")}


def load_robot(robot: str | Path, *, allow_outside: bool = False) -> Robot:
    """A robot by built-in name or by the path of its manifest; no part is read yet.

    Parameters
    ----------
    robot : str or Path
        "icub", "kaspar", "baxter-forearm", or a manifest (.toml).
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
        return replace_fields(read_manifest(builtin[str(robot)]), origin=str(robot))
    path = Path(robot)
    if path.suffix == ".toml" or is_file(path):
        return read_manifest(path, allow_outside=allow_outside)
    raise UnknownNameError(
        "robot (built in, or a path to a manifest .toml)", str(robot), sorted(builtin)
    )


def read_manifest(path: Path, *, allow_outside: bool = False) -> Robot:
    """A robot from its manifest file; see `load_robot`."""
    if not is_file(path):
        raise MissingFileError(path, "a robot manifest (.toml)")
    try:
        document = tomllib.loads(read_text(path))
    except (ValueError, RecursionError) as error:  # huge numbers and deep nests are no TOML errors
        raise DataFormatError(f"not TOML: {str(error)[:200]}", path) from None
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


def beside(manifest: Path, name: str, inside: Path | None) -> Path:
    """The path of a file named in a manifest, which may not lead out of the folder `inside`.

    Raises
    ------
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
            f"{manifest} names {name!r}, outside its own folder; allow it with --allow-outside"
        )
    return path


def _body(head: _Robot, path: Path, inside: Path | None) -> Body:
    """The URDF of a robot, or the one mesh of a single body."""
    if head.mesh is not None and head.urdf is None:
        return MeshBody(beside(path, head.mesh, inside), scale=_metres(head.units))
    if head.urdf is None or head.mesh is not None:
        raise DataFormatError("[robot] needs either 'urdf' or 'mesh'", path)
    if ":" in head.urdf:
        return UrdfBody(_package_model(head.urdf, path))
    return UrdfBody(beside(path, head.urdf, inside), inside=inside)


def _metres(unit: str) -> float:
    if unit not in UNITS:
        raise UnknownNameError("unit", unit, UNITS)
    return UNITS[unit]


def _part(entry: _Part, path: Path, inside: Path | None) -> Part:
    layout = None
    if entry.module is not None:
        layout = module_layout(_layout_name(entry.module, path, inside))
    return Part(
        entry.name,
        entry.link,
        _reader(beside(path, entry.taxels, inside), entry.format, _metres(entry.units)),
        layout,
        entry.frame,
        None if entry.drawing is None else beside(path, entry.drawing, inside),
    )


def _layout_name(module: str, path: Path, inside: Path | None) -> str:
    """The name of a built-in layout, or the path of a file that exists."""
    if not module.endswith((".toml", ".csv")):
        return module
    file = beside(path, module, inside)
    if not is_file(file):
        raise MissingFileError(file, "a module layout")
    return str(file)


def _reader(path: Path, format: str | None, scale: float) -> Callable[[], TaxelTable]:
    def read() -> TaxelTable:
        table = read_taxels(path, format)
        return replace(table, positions=table.positions * scale)

    return read


def _pose(angles_deg: Mapping[str, object], body: Body, path: Path) -> dict[str, float]:
    pose = {}
    for joint, angle in angles_deg.items():
        if joint not in body.joints:
            raise UnknownNameError("joint", joint, body.joints)
        number = isinstance(angle, int | float) and not isinstance(angle, bool)
        if not number or not abs(angle) <= MAX_DEGREES:  # type: ignore[arg-type]  # nor is NaN
            raise DataFormatError(f"pose_deg.{joint} must be a number, got {angle!r}", path)
        pose[joint] = math.radians(angle)  # type: ignore[arg-type]
    return pose


def _package_model(urdf: str, manifest: Path) -> Path:
    """The URDF of `package:model`, a model of an installed package of robots."""
    package, _, model = urdf.partition(":")
    if package not in MODEL_PACKAGES:
        # Importing runs code: a manifest must not choose which.
        raise UnknownNameError("package of robot models", package, MODEL_PACKAGES)
    module = importlib.import_module(package.replace("-", "_"))
    if model not in module.get_robot_names():
        raise UnknownNameError(f"model in {package}", model, module.get_robot_names())
    return Path(module.get_model_file(model))
