"""Saved views: what is shown and from where, in a small JSON file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from skinmap.errors import DataFormatError, MissingFileError
from skinmap.io.output import staged_file

FORMAT = "skinmap-view"
VERSION = 1
LARGEST = 4_000_000  # bytes: far above a view with every taxel of a large skin chosen
LARGEST_NUMBER = 1e300  # still finite in sums
MODES = ("auto", "still", "free")
STYLES = ("discs", "surface")
TRIPLES = ("position", "focus", "up")


@dataclass(frozen=True, slots=True)
class SavedView:
    """What a file of version 1 holds.

    Attributes
    ----------
    robot : str
        Name of the robot that it was saved of.
    position, focus, up : (float, float, float)
        Of the camera, in the world [m].
    angle : float
        Vertical view angle [deg].
    mode : {"auto", "still", "free"}
        What the camera does by itself.
    layer, style : str
        What the skin shows and how.
    part : str
        Whose flat map is shown; empty for none.
    selection : mapping of str to tuple of int
        Chosen taxels of each part.
    """

    robot: str
    position: tuple[float, float, float]
    focus: tuple[float, float, float]
    up: tuple[float, float, float]
    angle: float
    mode: str = "free"
    layer: str = "pressure"
    style: str = "surface"
    part: str = ""
    selection: Mapping[str, tuple[int, ...]] = field(default_factory=dict)


def save_view(view: SavedView, path: Path) -> Path:
    """Write a view.

    Raises
    ------
    OutputError
        The folder does not exist or cannot be written to.
    """
    with staged_file(path) as stage:
        stage.write_text(json.dumps(content_of(view), indent=2) + "\n", encoding="utf-8")
    return path


def content_of(view: SavedView) -> dict[str, Any]:
    """What is written of a view."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "robot": view.robot,
        "camera": {
            "position": view.position,
            "focus": view.focus,
            "up": view.up,
            "angle": view.angle,
            "mode": view.mode,
        },
        "layer": view.layer,
        "style": view.style,
        "part": view.part,
        "selection": {part: list(taxels) for part, taxels in view.selection.items()},
    }


def load_view(path: Path) -> SavedView:
    """Read a view.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file; one that is damaged, too large, no view at all or of another version.
    """
    if not path.is_file():
        raise MissingFileError(path, "a view saved by the viewer (key v)")
    try:
        if path.stat().st_size > LARGEST:
            raise DataFormatError(f"more than {LARGEST} bytes: no saved view", path)
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataFormatError(f"cannot be read: {error.strerror}", path) from None
    except (UnicodeDecodeError, RecursionError):
        raise DataFormatError("no saved view: not JSON text", path) from None
    except json.JSONDecodeError as error:
        raise DataFormatError(f"damaged view: {error.msg}", path, error.lineno) from None
    except ValueError:  # Python refuses whole numbers of thousands of digits
        raise DataFormatError("damaged view: a number of too many digits", path) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise DataFormatError(f'no saved view: "format": "{FORMAT}" expected', path)
    if content.get("version") != VERSION:
        raise DataFormatError(
            f"view of version {content.get('version')!r}; this Skinmap reads version {VERSION}",
            path,
        )
    return _parse(content, path)


def _parse(content: dict[str, Any], path: Path) -> SavedView:
    camera = content.get("camera")
    if not isinstance(camera, dict):
        raise DataFormatError('damaged view: "camera" expected', path)
    position, focus, up = (_triple(camera, name, path) for name in TRIPLES)
    angle: Any = camera.get("angle")
    if not _number(angle) or not 0.1 <= angle <= 170.0:
        raise DataFormatError(f"damaged view: camera angle {angle!r}, degrees expected", path)
    if math.dist(position, focus) < 1e-9 or math.hypot(*up) < 1e-9:
        raise DataFormatError("damaged view: the camera looks nowhere", path)
    return SavedView(
        robot=_text(content, "robot", path),
        position=position,
        focus=focus,
        up=up,
        angle=float(angle),
        mode=_choice(camera, "mode", MODES, path),
        layer=_text(content, "layer", path),
        style=_choice(content, "style", STYLES, path),
        part=_text(content, "part", path),
        selection=_selection(content.get("selection", {}), path),
    )


def _number(value: Any) -> bool:
    # Compared, not converted: a whole number may be too large for a float.
    return type(value) in (int, float) and -LARGEST_NUMBER <= value <= LARGEST_NUMBER


def _triple(camera: dict[str, Any], name: str, path: Path) -> tuple[float, float, float]:
    value = camera.get(name)
    if not isinstance(value, list) or len(value) != 3 or not all(map(_number, value)):
        raise DataFormatError(f'damaged view: three numbers expected as camera "{name}"', path)
    return (float(value[0]), float(value[1]), float(value[2]))


def _text(content: dict[str, Any], name: str, path: Path) -> str:
    value = content.get(name, "")
    if not isinstance(value, str):
        raise DataFormatError(f'damaged view: a text expected as "{name}"', path)
    return value


def _choice(content: dict[str, Any], name: str, known: tuple[str, ...], path: Path) -> str:
    value = content.get(name)
    if value not in known:
        raise DataFormatError(
            f'damaged view: "{name}" is {value!r}; expected one of: {", ".join(known)}', path
        )
    return str(value)


def _selection(value: Any, path: Path) -> dict[str, tuple[int, ...]]:
    if not isinstance(value, dict):
        raise DataFormatError('damaged view: parts with taxels expected as "selection"', path)
    for part, taxels in value.items():
        good = isinstance(taxels, list) and all(type(one) is int and one >= 0 for one in taxels)
        if not good:
            raise DataFormatError(f"damaged view: rows of taxels expected for {part!r}", path)
    return {part: tuple(taxels) for part, taxels in value.items()}
