"""Robot manifests: which body, which parts, which taxel tables (schema in docs/manifest.md)."""

from __future__ import annotations

import importlib
import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

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

MODEL_PACKAGES = ("icub-models",)
PART_KEYS = {"name", "link", "taxels", "format", "units", "module", "drawing", "frame"}
ROBOT_KEYS = {"name", "urdf", "mesh", "units", "pose_deg"}
MAX_DEGREES = 36_000  # a hundred turns


def data_folder() -> Path:
    """The folder of built-in data: inside the installed package, else beside it in a checkout."""
    package = Path(skinmap.__file__).resolve().parent
    return package / "data" if (package / "data").is_dir() else package.parent / "data"


def builtin_robots() -> tuple[str, ...]:
    """Names of the robots that ship with Skinmap."""
    return tuple(sorted(_builtin_manifests()))


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
        return read_manifest(builtin[str(robot)])
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
    unknown = set(document) - {"robot", "part"}
    if unknown:
        raise DataFormatError(
            f"unknown tables {', '.join(sorted(unknown))}; the tables are: robot, part", path
        )
    head = _table(document.get("robot"), ROBOT_KEYS, {"name"}, "[robot]", path)
    entries = document.get("part", [])
    if not isinstance(entries, list) or not entries:
        raise DataFormatError("a manifest needs at least one [[part]]", path)
    inside = None if allow_outside else path.resolve().parent
    body = _body(head, path, inside)
    parts: dict[str, Part] = {}
    for number, entry in enumerate(entries, start=1):
        what = f"[[part]] number {number}"
        keys = _table(entry, PART_KEYS, {"name", "link", "taxels"}, what, path)
        part = _part(keys, path, inside)
        if part.name in parts:
            raise DataFormatError(f"two parts are called {part.name!r}", path)
        if part.link not in body.links:
            raise UnknownNameError(f"link (part {part.name!r})", part.link, body.visible_links)
        parts[part.name] = part
    return Robot(head["name"], body, parts, _pose(head.get("pose_deg", {}), body, path))


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


def _body(head: dict[str, Any], path: Path, inside: Path | None) -> Body:
    """The URDF of a robot, or the one mesh of a single body."""
    if ("urdf" in head) == ("mesh" in head):
        raise DataFormatError("[robot] needs either 'urdf' or 'mesh'", path)
    if "mesh" in head:
        mesh = beside(path, head["mesh"], inside)
        return MeshBody(mesh, scale=_metres(head.get("units", "m")))
    if ":" in head["urdf"]:
        return UrdfBody(_package_model(head["urdf"], path))
    return UrdfBody(beside(path, head["urdf"], inside), inside=inside)


def _metres(unit: str) -> float:
    if unit not in UNITS:
        raise UnknownNameError("unit", unit, UNITS)
    return UNITS[unit]


def _part(entry: dict[str, Any], path: Path, inside: Path | None) -> Part:
    table = beside(path, entry["taxels"], inside)
    layout = None
    if "module" in entry:
        layout = module_layout(_layout_name(entry["module"], path, inside))
    return Part(
        entry["name"],
        entry["link"],
        _reader(table, entry.get("format"), _metres(entry.get("units", "m"))),
        layout,
        entry.get("frame", AUTO),
        beside(path, entry["drawing"], inside) if "drawing" in entry else None,
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


def _pose(angles_deg: Any, body: Body, path: Path) -> dict[str, float]:
    if not isinstance(angles_deg, dict):
        raise DataFormatError(f"pose_deg must be a table, got {angles_deg!r}", path)
    pose = {}
    for joint, angle in angles_deg.items():
        if joint not in body.joints:
            raise UnknownNameError("joint", joint, body.joints)
        number = isinstance(angle, int | float) and not isinstance(angle, bool)
        if not number or not abs(angle) <= MAX_DEGREES:  # which NaN is not
            raise DataFormatError(f"pose_deg.{joint} must be a number, got {angle!r}", path)
        pose[joint] = math.radians(angle)
    return pose


def _table(entry: Any, keys: set[str], needed: set[str], what: str, path: Path) -> dict[str, Any]:
    if not isinstance(entry, dict):
        raise DataFormatError(f"a manifest needs {what}", path)
    if set(entry) - keys:
        raise DataFormatError(
            f"{what} has unknown keys {', '.join(sorted(set(entry) - keys))}; the keys are: "
            f"{', '.join(sorted(keys))}",
            path,
        )
    for key in keys - {"pose_deg"}:
        if key in needed and key not in entry:
            raise DataFormatError(f"{what} lacks {key!r}", path)
        if key in entry and not isinstance(entry[key], str):
            raise DataFormatError(f"{key} of {what} must be text, got {entry[key]!r}", path)
    return entry


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
