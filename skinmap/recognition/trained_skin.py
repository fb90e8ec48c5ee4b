"""The skins that a classifier was trained on, and how another skin differs from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinmap.arrays import FloatArray, freeze
from skinmap.geometry.proximity import median_spacing
from skinmap.skin.skin import Skin, layout_fingerprint

MM = 1e3


@dataclass(frozen=True, eq=False, slots=True)
class TrainedSkin:
    """What a model remembers of a skin.

    Attributes
    ----------
    part : str
    positions : (n, 3) float
        [m].
    """

    part: str
    positions: FloatArray

    def __post_init__(self) -> None:
        freeze(self, positions=self.positions)

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the part's name and the positions in micrometres."""
        return layout_fingerprint(self.part, self.positions)


@dataclass(frozen=True, slots=True)
class SkinDifference:
    """How a skin differs from what a model was trained on.

    Attributes
    ----------
    message : str
        One line; empty for the same skin.
    may_go_on : bool
        Whether the model can name touches there.
    """

    message: str
    may_go_on: bool


def remember(skin: Skin) -> TrainedSkin:
    """What a model keeps of a skin."""
    return TrainedSkin(skin.part, skin.positions)


def compare_skin(trained: Sequence[TrainedSkin], skin: Skin, *, one_skin: bool) -> SkinDifference:
    """What is different about a skin.

    Parameters
    ----------
    trained : sequence of TrainedSkin
        What a model was trained on.
    skin : Skin
        What it is asked about.
    one_skin : bool
        Whether the model reads taxels by their number, so that they must stay where they were:
        within half a pitch. Other models carry over.
    """
    now = remember(skin)
    if any(one.fingerprint == now.fingerprint for one in trained):
        return SkinDifference("", True)
    same_part = [one for one in trained if one.part == skin.part]
    if not same_part:
        parts = ", ".join(one.part for one in trained) or "no part"
        return SkinDifference(f"{skin.part!r} was not trained on ({parts} were)", not one_skin)
    before = same_part[0].positions
    if len(before) != len(skin):
        return SkinDifference(
            f"{skin.part!r} has {len(skin)} taxels, the model learnt it with {len(before)}",
            not one_skin,
        )
    moved = np.linalg.norm(skin.positions - before, axis=1)
    most, half = float(moved.max(initial=0.0)), 0.5 * median_spacing(before)
    if most <= half:
        return SkinDifference(f"taxels of {skin.part!r} moved by up to {most * MM:.3g} mm", True)
    return SkinDifference(
        f"{skin.part!r} has another layout: taxels moved by up to {most * MM:.3g} mm, "
        f"more than half the pitch ({half * MM:.3g} mm)",
        not one_skin,
    )
