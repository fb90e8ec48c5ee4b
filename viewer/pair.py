"""Two sources side by side: parts and touches that they have in common, and how these differ."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import starmap
from typing import TYPE_CHECKING

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.skin.skin import fingerprint
from skinmap.touch.prepared_skin import PreparedSkin

if TYPE_CHECKING:
    from viewer.layers import Layer, Layers

LEFT, RIGHT = "left", "right"
ORDER = f"{RIGHT} less {LEFT}"
Touches = tuple[NamedTouch | None, NamedTouch | None]


class Pair:
    """Layers of two scenes that stand side by side, for the layer "difference" of both.

    Parameters
    ----------
    left, right : Layers

    Attributes
    ----------
    parts : tuple of str
        Parts of the same skin.
    """

    def __init__(self, left: Layers, right: Layers) -> None:
        self.left, self.right = left, right
        self.parts = common_parts(left.skins, right.skins)
        left.stand_in(self)
        right.stand_in(self)

    def values(self, part: str) -> FloatArray | None:
        """(n,) pressures now at the right, less those at the left; None without a common skin."""
        if part not in self.parts:
            return None
        return self.right.pressed(part) - self.left.pressed(part)

    def on_one_scale(self, layer: Layer) -> Layer:
        """A layer of either side, with limits that hold those of both."""
        sides = (
            [] if layer.categories else [one.build(layer.name) for one in (self.left, self.right)]
        )
        limits = [one.limits for one in sides if one.unit == layer.unit] or [layer.limits]
        return replace(layer, limits=(min(a for a, _ in limits), max(b for _, b in limits)))

    def touches(self) -> tuple[NamedTouch, ...]:
        """Touches of the common parts now, with both names and the way between both places."""
        sides = [
            () if one.moment is None else [t for t in one.moment.touches if t.part in self.parts]
            for one in (self.left, self.right)
        ]
        return tuple(starmap(moved_touch, paired_touches(*sides)))


def common_parts(
    left: Mapping[str, PreparedSkin], right: Mapping[str, PreparedSkin]
) -> tuple[str, ...]:
    """Parts of the same name and the same skin."""
    return tuple(
        part
        for part, skin in left.items()
        if part in right and fingerprint(skin.skin) == fingerprint(right[part].skin)
    )


def paired_touches(left: Sequence[NamedTouch], right: Sequence[NamedTouch]) -> list[Touches]:
    """Touches of both, each with that of its part with most taxels in common, or the nearest."""
    rest: list[NamedTouch] = list(right)
    rows: list[Touches] = []
    for touch in left:
        here = [one for one in rest if one.part == touch.part]
        mate = min(here, key=_apart(touch), default=None)
        if mate is not None:
            rest.remove(mate)
        rows.append((touch, mate))
    return rows + [(None, touch) for touch in rest]


def moved_touch(left: NamedTouch | None, right: NamedTouch | None) -> NamedTouch:
    """The touch as the difference shows it: both names, and the way from its place at the left."""
    either = right or left
    assert either is not None
    name, path = either.label, None
    if left is None or right is None:
        name = f"{name}, {RIGHT if left is None else LEFT} only"
    else:
        name = name if name == left.label else f"{left.label}, {RIGHT} {name}"
        path = np.stack([left.centre, right.centre])
    return replace(
        either, label=name, confidence=np.nan, path=path, motion=None, answers=None, load=None
    )


def _apart(touch: NamedTouch) -> Callable[[NamedTouch], tuple[int, float]]:
    def key(one: NamedTouch) -> tuple[int, float]:
        shared = len(np.intersect1d(one.taxels, touch.taxels))
        return -shared, float(np.linalg.norm(one.centre - touch.centre))

    return key
