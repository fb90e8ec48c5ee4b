"""A moment of the skin: what the loop hands to a viewer, a publisher or a command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.summary import Drawable, listed
from skinmap.touch.prepared_skin import PreparedSkin

Rows = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Moment(Drawable):
    """One sample of all parts, and the touches found in it.

    Attributes
    ----------
    time : float
        Of the sample, in the source's clock [s].
    pressures : mapping of str to (n,) array
        Of each part's taxels, dense rows, 0 to 255 counts.
    touches : tuple of NamedTouch
        What is touched now.
    raw : mapping of str to (n,) array
        What the sensors sent for the same taxels; empty where the source sends pressures.
    angles : mapping of str to float
        Joint angles [rad]; empty where the source has none.
    stale : bool
        Nothing has come for a while: pressures are those of the last sample.
    rate : float
        Samples a second that came lately; NaN where nobody counts.
    latency : float
        From a sample's arrival to this moment [s]; NaN where nobody measures.
    dropped : int
        Samples left out so far because they came quicker than they were used.
    states : mapping of str to (n,) array of str
        Of each part's taxels: "ok", "stuck", "noisy", "dead", or "unheard": no number, or no rest
        seen yet; "dead": silent while those around it were pressed.
    skins : mapping of str to PreparedSkin
        Of the parts, for `plot` and `save`; a `TouchLoop` gives them.
    block : tuple, optional
        All k samples of the step that ends in this moment: times (k,) [s], then `pressures` and
        `raw` of them, (k, n) by part.

    Examples
    --------
    >>> import numpy as np, skinmap
    >>> skinmap.live.Moment(0.02, {"torso": np.zeros(480)})
    Moment(time=0.020 s, parts=torso, touches=none, stale=False)
    """

    FIGURE: ClassVar = "skinmap.report.touch_figures:moment_figure"
    time: float
    pressures: Mapping[str, NDArray[Any]]
    touches: tuple[NamedTouch, ...] = ()
    raw: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    angles: Mapping[str, float] = field(default_factory=dict)
    stale: bool = False
    rate: float = float("nan")
    latency: float = float("nan")
    dropped: int = 0
    states: Mapping[str, NDArray[np.str_]] = field(default_factory=dict)
    skins: Mapping[str, PreparedSkin] = field(default_factory=dict)
    block: tuple[FloatArray, Rows, Rows] | None = None

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "time": f"{self.time:.3f} s",
            "parts": listed(self.pressures),
            "touches": listed(f"{one.label} on {one.part}" for one in self.touches),
            "stale": self.stale,
        }
