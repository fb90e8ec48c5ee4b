"""A touch with its name: what the viewer shows and the commands print."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skinmap.arrays import FloatArray, IntArray, freeze
from skinmap.live.contacts.contact_motion import Motion
from skinmap.summary import Summary

if TYPE_CHECKING:
    from skinmap.live.contacts.contact_forces import ContactForce
    from skinmap.recognition.answers import Answer, Answers, HandAnswer

UNNAMED = "touch"  # what a touch is called while nobody has named it


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class NamedTouch(Summary):
    """One touch on one part at one moment.

    Attributes
    ----------
    part : str
    taxels : (k,) int
        Active taxels, dense rows of the part's skin.
    centre : (3,) float
        Centre of pressure on the surface, in the link's frame [m].
    label : str
        Name of the touch.
    confidence : float
        Confidence in the label, 0 to 1.
    identity : int
        The same number from its first sample to its last; -1 where nobody follows it.
    began : float
        Time of its first sample, in the source's clock [s].
    normal : (3,) float or None
        Mean outward direction of the touched skin, unit length, in the link's frame.
    area : float
        Touched skin [m2].
    peak, mean : float
        Largest and mean pressure of its taxels [counts].
    force : float or None
        [N], where the response is calibrated by loads.
    path : (p, 3) float or None
        Where its centre has been, oldest first, along the surface, in the link's frame [m].
    motion : Motion or None
        Which way it moves and how fast, its way and rhythm, and the answer how; None of one that is
        not followed.
    answers : Answers or None
        Kind, motion and hand; None where no model gives them.
    load : ContactForce or None
        Force, area and pressures, where the part has a load calibration.

    Examples
    --------
    >>> import numpy as np, skinmap
    >>> skinmap.live.NamedTouch("torso", np.array([3, 4]), np.zeros(3), "poke", 0.9)
    NamedTouch(label=poke, confidence=0.90, part=torso, taxels=2)
    """

    part: str
    taxels: IntArray
    centre: FloatArray
    label: str
    confidence: float
    identity: int = -1
    began: float = float("nan")
    normal: FloatArray | None = None
    area: float = float("nan")
    peak: float = float("nan")
    mean: float = float("nan")
    force: float | None = None
    path: FloatArray | None = None
    motion: Motion | None = None
    answers: Answers | None = None
    load: ContactForce | None = None

    def __post_init__(self) -> None:
        freeze(self, taxels=self.taxels, centre=self.centre)
        if self.normal is not None:
            freeze(self, normal=np.asarray(self.normal, np.float64))
        if self.path is not None:
            freeze(self, path=np.asarray(self.path, np.float64))

    @property
    def kind(self) -> Answer | None:
        """With what."""
        return None if self.answers is None else self.answers.kind

    @property
    def hand(self) -> HandAnswer | None:
        """Whether it is a hand."""
        return None if self.answers is None else self.answers.hand

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "label": self.label,
            "confidence": f"{self.confidence:.2f}",
            "part": self.part,
            "taxels": len(self.taxels),
        }
