"""A touch with its name: what the viewer shows and the commands print."""

from __future__ import annotations

from dataclasses import dataclass

from skinmap.arrays import FloatArray, IntArray, freeze


@dataclass(frozen=True, eq=False, slots=True)
class NamedTouch:
    """One touch on one part at one moment.

    Attributes
    ----------
    part : str
    taxels : (k,) int
        Active taxels, dense rows of the part's skin.
    centre : (3,) float
        Taxel position nearest to the centre of pressure, in the link's frame [m].
    label : str
        Name of the touch.
    confidence : float
        0 to 1.
    """

    part: str
    taxels: IntArray
    centre: FloatArray
    label: str
    confidence: float

    def __post_init__(self) -> None:
        freeze(self, taxels=self.taxels, centre=self.centre)
