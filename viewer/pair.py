"""Two sources side by side: parts and touches that they have in common, and how these differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    """Touches of both; of a part those with most taxels in common are mates, then the nearest."""
    ways = sorted(
        (_apart(touch, one), k, m)
        for k, touch in enumerate(left)
        for m, one in enumerate(right)
        if touch.part == one.part
    )
    mates: dict[int, int] = {}
    for _, k, m in ways:  # the best of all ways first, whatever the order of the touches
        if k not in mates and m not in mates.values():
            mates[k] = m
    rows: list[Touches] = [
        (touch, right[mates[k]] if k in mates else None) for k, touch in enumerate(left)
    ]
    return rows + [(None, one) for m, one in enumerate(right) if m not in mates.values()]


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


def _apart(touch: NamedTouch, one: NamedTouch) -> tuple[int, float]:
    shared = len(np.intersect1d(one.taxels, touch.taxels))
    return -shared, float(np.linalg.norm(one.centre - touch.centre))
