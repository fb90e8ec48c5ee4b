"""Saved views: what is shown, from where and how, in a small JSON file."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec
import numpy as np

from skinmap.errors import (
    DataFormatError,
    OutputError,
    SkinError,
    SkinMismatchError,
    check_known,
)
from skinmap.io.output import staged_file
from skinmap.io.text import check_file, read_text
from skinmap.skin.robot import Robot
from viewer.interaction.mouse import Selection
from viewer.scene import Scene, check_part, check_taxels

FORMAT = "skinmap-view"
VERSION = 1
LARGEST = 4_000_000  # bytes: far above a view with every taxel of a large skin chosen
Number = Annotated[float, msgspec.Meta(ge=-1e300, le=1e300)]  # still finite in sums
T = TypeVar("T")
Triple = tuple[Number, Number, Number]
LENS = ("position", "focus", "up", "angle", "mode")  # stand under "camera" in the file
Side = Annotated[int, msgspec.Meta(ge=160, le=8000)]  # of a picture [px]


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
    position: Triple
    focus: Triple
    up: Triple
    angle: Annotated[float, msgspec.Meta(ge=0.1, le=170.0)]
    mode: Literal["auto", "still", "free"] = "free"
    layer: str = "pressure"
    style: Annotated[str, msgspec.Meta(pattern="^(surface|discs)$")] = "surface"
    part: str = ""
    selection: dict[str, tuple[Annotated[int, msgspec.Meta(ge=0)], ...]] = field(
        default_factory=dict
    )


class Settings(msgspec.Struct, frozen=True):
    """How all is drawn: what stands in the file beside the camera, or without one.

    Attributes
    ----------
    layer : str or None
    style : {"surface", "discs"} or None
    links : {"all", "skin", "none"}
        What is drawn of the body: all, the links with the parts' skin, nothing.
    size : (int, int) or None
        Width and height of the picture [px].
    ranges : dict of str to (float, float)
        Values of the first and last colour of layers.
    pose : dict of str to float
        Joint angles [deg]; the natural pose without.
    """

    layer: str | None = None
    style: Literal["surface", "discs"] | None = None
    links: Literal["all", "skin", "none"] = "all"
    size: tuple[Side, Side] | None = None
    ranges: dict[str, tuple[float, float]] = {}
    pose: dict[str, float] = {}


CAMERA = ("format", "version", "robot", "camera", "part", "selection")


def load_settings(path: Path) -> Settings:
    """Read how all is drawn from the file of a view, with a camera in it or without.

    Raises
    ------
    MissingFileError, DataFormatError, UnknownNameError
        As `load_view`; a setting that does not exist, or with another value than it can have.
    """
    content = _content(path)
    names = (*CAMERA, *Settings.__struct_fields__)
    for name in content:
        check_known(f"setting in {str(path)!r}", [name], names)
    return _convert(content, Settings, path)


def save_view(view: SavedView, path: Path) -> Path:
    """Write a view; what the file already says of links, size, ranges and pose stays.

    Raises
    ------
    OutputError
        The folder does not exist or cannot be written to.
    """
    content = content_of(view)
    with suppress(SkinError):
        before = _content(path)
        content |= {name: before[name] for name in Settings.__struct_fields__[2:] if name in before}
    with staged_file(path) as stage:
        stage.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return path


def content_of(view: SavedView) -> dict[str, Any]:
    """What is written of a view."""
    content = asdict(view)
    camera = {name: content.pop(name) for name in LENS}
    return {"format": FORMAT, "version": VERSION, "camera": camera, **content}


def load_view(path: Path) -> SavedView:
    """Read a view.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file; one that is damaged, too large, no view at all or of another version.
    """
    content = _content(path)
    camera = content.get("camera")
    if not isinstance(camera, dict):
        raise DataFormatError('damaged view: "camera" expected', path)
    view = _convert({**content, **camera}, SavedView, path)
    if math.dist(view.position, view.focus) < 1e-9 or math.hypot(*view.up) < 1e-9:
        raise DataFormatError("damaged view: the camera looks nowhere", path)
    return view


def _convert(content: dict[str, Any], kind: type[T], path: Path) -> T:
    """A file's content as what it is to be."""
    try:
        return msgspec.convert(content, kind)
    except (msgspec.ValidationError, OverflowError) as error:
        raise DataFormatError(f"damaged view: {error}", path) from None


def has_camera(path: Path) -> bool:
    """Whether a file says from where to look; one with settings alone does not."""
    return "camera" in _content(path)


def _content(path: Path) -> dict[str, Any]:
    """A file's content, if it is that of a view."""
    check_file(path, "a view saved by the viewer (key v)", LARGEST)
    text = read_text(path)
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise DataFormatError(f"damaged view: {error.msg}", path, error.lineno) from None
    except RecursionError:
        raise DataFormatError("no saved view: not JSON text", path) from None
    except ValueError:  # Python refuses whole numbers of thousands of digits
        raise DataFormatError("damaged view: a number of too many digits", path) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise DataFormatError(f'no saved view: "format": "{FORMAT}" expected', path)
    if content.get("version") != VERSION:
        raise DataFormatError(
            f"view of version {content.get('version')!r}; this Skinmap reads version {VERSION}",
            path,
        )
    return content


# What keys save: views of a scene, and pictures under names that are still free.

NUMBERS = 100_000


def free_name(folder: Path, stem: str, suffix: str) -> Path:
    """A file of the folder that does not exist yet: nothing is ever written over.

    Raises
    ------
    OutputError
        The folder is not there, or full of such names.
    """
    if not folder.is_dir():
        raise OutputError(f"no folder {str(folder)!r} to write to")
    for number in range(1, NUMBERS):
        path = folder / f"{stem}-{number:03d}{suffix}"
        if not path.exists():
            return path
    raise OutputError(f"too many files {stem}-*{suffix} in {str(folder)!r}")


def view_of(scene: Scene, selection: Selection) -> SavedView:
    """What a scene shows now, and from where."""
    camera = scene.plotter.renderers[0].GetActiveCamera()
    return SavedView(
        robot=scene.robot.name,
        position=camera.GetPosition(),
        focus=camera.GetFocalPoint(),
        up=camera.GetViewUp(),
        angle=camera.GetViewAngle(),
        mode=scene.framing.mode,
        layer=scene.layer.name,
        style=scene.style,
        part="" if scene.panel is None else scene.panel.part,
        selection={part: tuple(map(int, taxels)) for part, taxels in selection.items()},
    )


def check_view(view: SavedView, robot: Robot) -> None:
    """Raise SkinMismatchError for a view of another robot."""
    if view.robot != robot.name:
        raise SkinMismatchError(
            f"the view was saved of {view.robot!r}, this robot is {robot.name!r}"
        )


def apply_view(scene: Scene, view: SavedView, selection: Selection) -> None:
    """Show what was saved; nothing changes where it does not fit the scene.

    Raises
    ------
    SkinMismatchError, UnknownNameError, InvalidArrayError
        A view of another robot, with taxels that are not there or a layer that does not exist.
    """
    check_view(view, scene.robot)
    for part, taxels in view.selection.items():
        check_taxels(taxels, part, len(check_part(part, scene.layers).skin))
    scene.set_layer(view.layer)
    scene.set_style(view.style)
    if view.part and scene.panel is not None:
        scene.show_flat_map(view.part)
    selection.clear()
    for part, taxels in view.selection.items():
        selection.set(part, np.array(taxels, np.int64))
    scene.framing.mode = "auto" if view.mode == "auto" else "free"
    renderer = scene.plotter.renderers[0]
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*view.position)
    camera.SetFocalPoint(*view.focus)
    camera.SetViewUp(*view.up)
    camera.SetViewAngle(view.angle)
    renderer.ResetCameraClippingRange()
