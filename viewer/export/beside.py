"""Two recordings, moments, models or calibrations in one picture, and how they differ."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import starmap
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError
from skinmap.io.output import staged_file
from skinmap.live.contacts.named_touch import Moment, NamedTouch
from skinmap.touch.contacts.skin_geometry import ACTIVE
from viewer.colours import DIFFERENCE_STOPS, INK, ramp
from viewer.layers import LEFT, ORDER, RIGHT, Layer, Pair, moved_touch, paired_touches, touches_at
from viewer.results import Beside, ChangedTouch, Difference
from viewer.scene import Scene
from viewer.view_files import NEAR, shown_touches, still_moment
from viewer.view_options import Look, Session, look_beside, new_scene

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont

SIZE = (1100, 800)  # of each of the pictures [px]
LINES = 24  # of touches that are listed at most


def write_beside(
    session: Session,
    other: Session,
    look: Look,
    path: Path,
    at: float | None,
    *,
    then: float | None = None,
    named: str = "",
) -> tuple[Moment | None, Beside]:
    """Write a picture of two sources and of their difference, where they have a skin in common.

    Parameters
    ----------
    session, other : Session
        Left and right.
    look : Look
    path : Path
        Of the picture.
    at : float or None
        Of both [s]; by default what shows most of the left one, and the same of the right one
        where it lasts so long.
    then : float or None
        Of the right one alone [s].
    named : str
        What the right one differs in: its model or calibration.

    Returns
    -------
    Moment or None
        Of the left one.
    Beside
        What stands at the right, and the difference.
    """
    first = _moment(session, look, at)
    asked = at if then is None else then
    wanted = asked
    if asked is None and first is not None and other.repeats:
        wanted = first.time - session.origin
    second = _moment(other, look, wanted, strict=asked is not None)
    scenes = [_scene(session, look, first)]
    scenes.append(_scene(other, look_beside(look, session, other), second))
    try:
        left, right = scenes
        common = Pair(left.data, right.data).parts
        for scene in scenes:
            scene.set_layer(scene.layer.name)  # on the scale of both
        left.set_title(_title(LEFT, session, first))
        right.set_title(_title(RIGHT, other, second) + (named and f", {named}"))
        pictures = [left.canvas.draw(left, 360.0, samples=8)]
        if session.robot.name == other.robot.name:
            right.framing.look(left.framing.view, "still")
            right.canvas.touch_view.labels.forget()
        if common and left.panel is not None and left.panel.part in common:
            right.show_flat_map(left.panel.part)
        pictures.append(right.canvas.draw(right, 360.0, samples=8))
        note = "" if then is not None else _apart_in_time(session, other, first, second)
        names = f"{left.robot.name} and {right.robot.name}"
        found, lines = None, [f"no difference: {names} have no skin in common"]
        if common:
            values = difference(left, right, common)
            now = np.nan if second is None else second.time  # of the picture of the difference
            pairs = paired_touches(touches_at(first, now), touches_at(second, now))
            found = _measured(values, list(starmap(changed_touch, pairs)), least_of(left.layer))
            shown = [one for one in starmap(moved_touch, pairs) if one.part in common]
            moved = second and dataclasses.replace(second, touches=tuple(shown))
            pictures.append(_difference_picture(session, look, values, scenes, moved))
            lines = ([note, ""] if note else []) + _lines(found, left.layer)
        _compose(path, pictures, lines)
    finally:
        for scene in scenes:
            scene.close()
    return first, Beside(
        robot=other.robot.name,
        source=other.source,
        time=None if second is None else second.time - other.origin,
        touches=shown_touches(second),
        difference=found,
        note=note if common else lines[0],
    )


def _moment(
    session: Session, look: Look, at: float | None, *, strict: bool = True
) -> Moment | None:
    if (look.layer or "").startswith("touched"):
        return None
    try:
        return still_moment(session, look, at)
    except InvalidArrayError:  # it does not last so long
        if strict:
            raise
        return still_moment(session, look, None)


def _apart_in_time(
    session: Session, other: Session, first: Moment | None, second: Moment | None
) -> str:
    """That the two show different times, in words; empty where they do not."""
    if second is None:
        return "" if first is None else f"{RIGHT}: no sample"
    if first is None or not (session.repeats and other.repeats):
        return ""
    times = first.time - session.origin, second.time - other.origin
    if abs(times[1] - times[0]) <= NEAR:
        return ""
    return f"{LEFT} at {times[0]:.2f} s, {RIGHT} at {times[1]:.2f} s"


def _scene(session: Session, look: Look, moment: Moment | None) -> Scene:
    scene = new_scene(session, look, size=SIZE, off_screen=True)
    if moment is not None:
        scene.follow(moment)
    return scene


def _title(side: str, session: Session, moment: Moment | None) -> str:
    when = "" if moment is None else f", {moment.time - session.origin:.2f} s"
    return f"{side}: {session.title}{when}"


def difference(left: Scene, right: Scene, parts: Sequence[str]) -> dict[str, FloatArray]:
    """(n,) of each part: what the layer shows at the right, less what it shows at the left."""
    shown = {
        part: right.layer.values(part, right.moment) - left.layer.values(part, left.moment)
        for part in parts
    }
    if left.layer.categories:  # names have no difference but that they are others
        return {part: np.where(np.isnan(one), one, one != 0.0) for part, one in shown.items()}
    return shown


def changed_touch(left: NamedTouch | None, right: NamedTouch | None) -> ChangedTouch:
    """How a touch differs between left and right; None where it is not there."""
    either = left or right
    assert either is not None
    moved = None
    if left is not None and right is not None:
        moved = 1e3 * float(np.linalg.norm(right.centre - left.centre))
    return ChangedTouch(
        part=either.part,
        left=None if left is None else left.label,
        right=None if right is None else right.label,
        moved_mm=moved,
    )


def least_of(layer: Layer) -> float:
    """What two values of a layer must be apart to differ: of counts what a touch is."""
    return ACTIVE if layer.unit == "counts" else 0.0


def _measured(
    values: Mapping[str, FloatArray], touches: list[ChangedTouch], least: float
) -> Difference:
    every = np.concatenate([*values.values(), np.zeros(0)])
    known = np.abs(every[np.isfinite(every)])
    return Difference(
        parts=[part for part, one in values.items() if np.isfinite(one).any()],
        taxels=int((known > least).sum()),
        mean=float(known.mean()) if len(known) else 0.0,
        largest=float(known.max(initial=0.0)),
        touches=touches,
    )


def _difference_picture(
    session: Session,
    look: Look,
    values: Mapping[str, FloatArray],
    sides: Sequence[Scene],
    moment: Moment | None,
) -> NDArray[np.uint8]:
    """The difference on the body of the left one, seen as that is, with the touches of both."""
    left = sides[0]
    largest = max(
        (float(np.nanmax(np.abs(one), initial=0.0)) for one in values.values()), default=0
    )
    top = max(largest, 0.01 * (left.layer.limits[1] - left.layer.limits[0]))
    scene = new_scene(session, dataclasses.replace(look, layer=None), size=SIZE, off_screen=True)
    nothing = {part: np.full(len(skin), np.nan) for part, skin in session.skins.items()}

    def source(part: str, _: Moment | None) -> FloatArray:
        return values.get(part, nothing[part])

    unit = f"{left.layer.unit}, {ORDER}" if left.layer.unit else "1 where they differ"
    scene.layer = Layer(
        "difference", f"difference of {left.layer.title}", unit, (-top, top),
        ramp(DIFFERENCE_STOPS), source, missing="nothing in common",
    )  # fmt: skip
    for side in sides:
        scene.data.watch.join(side.data.watch)
    if moment is not None:
        scene.show_moment(moment)
    scene.set_title(f"difference: {ORDER}")
    if scene.panel is not None and left.panel is not None:
        scene.show_flat_map(left.panel.part)
    scene.framing.look(left.framing.view, "still")
    try:
        return scene.canvas.draw(scene, 360.0, samples=8)
    finally:
        scene.close()


def _lines(found: Difference, layer: Layer) -> list[str]:
    """What is written beside the difference."""
    unit, least = layer.unit.partition(",")[0], least_of(layer)
    lines = [
        f"{found.taxels:,} taxels differ by more than {least:g} {unit}",
        f"difference: {found.mean:.2f} {unit} on average, {found.largest:.1f} at most",
        "",
    ]
    for one in found.touches[:LINES]:
        part = one.part.replace("_", " ")
        if one.left is None or one.right is None:
            side, label = (RIGHT, one.right) if one.left is None else (LEFT, one.left)
            lines.append(f"{part}: {(label or '').replace('_', ' ')}, {side} only")
            continue
        names = one.left if one.left == one.right else f"{one.left}, right {one.right}"
        lines.append(f"{part}: {names.replace('_', ' ')}, moved {one.moved_mm or 0.0:.1f} mm")
    if len(found.touches) > LINES:
        lines.append(f"+{len(found.touches) - LINES} more")
    return lines


def _compose(path: Path, pictures: Sequence[NDArray[np.uint8]], lines: Sequence[str]) -> None:
    """The two side by side, and below them the difference beside what there is to say of it."""
    from PIL import Image, ImageDraw

    width, height = SIZE
    rows = 2 if len(pictures) > 2 else 1
    font = _font(26)
    low = 0 if rows == 2 else 60
    whole = Image.new("RGB", (2 * width, rows * height + low), "white")
    for place, picture in enumerate(pictures):
        whole.paste(Image.fromarray(picture), (place % 2 * width, place // 2 * height))
    draw = ImageDraw.Draw(whole)
    x, y = (width + 40, height + 40) if rows == 2 else (20, height + 14)
    for line in lines:
        draw.text((x, y), line, fill=INK, font=font)
        y += 36
    with staged_file(path) as stage:
        whole.save(stage)


def _font(size: int) -> FreeTypeFont:
    from matplotlib import get_data_path
    from PIL import ImageFont

    return ImageFont.truetype(str(Path(get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")), size)
