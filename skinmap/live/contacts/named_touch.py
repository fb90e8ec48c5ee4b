"""A touch with its name, as the viewer and the commands show it, and the events of touches.

A moment of the skin holds all that the loop hands to a viewer, a publisher or a command.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from skinmap.arrays import FloatArray, Frozen, IntArray, freeze
from skinmap.live.contacts.contact_motion import Motion
from skinmap.summary import Drawable, Summary, listed
from skinmap.touch.prepared_skin import PreparedSkin

if TYPE_CHECKING:
    from skinmap.live.response.loads import ContactForce
    from skinmap.recognition.answers import Answer, Answers, HandAnswer

UNNAMED = "touch"  # what a touch is called while nobody has named it


class _Answered(Summary):
    """What is answered of a touch, one by one."""

    __slots__ = ()
    answers: Answers | None

    @property
    def kind(self) -> Answer | None:
        """With what."""
        return None if self.answers is None else self.answers.kind

    @property
    def hand(self) -> HandAnswer | None:
        """Whether it is a hand."""
        return None if self.answers is None else self.answers.hand


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class NamedTouch(Frozen, _Answered):
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
    area, area_least : float
        Skin that feels the touch, and the least of it that is covered [m2].
    peak, mean : float
        Largest and mean pressure of its taxels [counts].
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
    path: FloatArray | None = None
    motion: Motion | None = None
    answers: Answers | None = None
    load: ContactForce | None = None
    area_least: float = float("nan")

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "label": self.label,
            "confidence": f"{self.confidence:.2f}",
            "part": self.part,
            "taxels": len(self.taxels),
        }


def words_of(touch: NamedTouch) -> tuple[str, ...]:
    """The three answers of a touch, without their numbers; none where nothing was answered."""
    said = touch.answers
    return () if said is None else (said.kind.answer, said.motion.answer, said.hand.answer)


Event = TypeVar("Event")
Happening = Literal["birth", "motion", "merge", "split", "end"]


@dataclass(frozen=True, slots=True)
class ContactEvent:
    """Something that happened to a contact.

    Attributes
    ----------
    kind : {"birth", "motion", "merge", "split", "end"}
    identity : int
        Of the contact: the new one of a split, the one that is left of a merge.
    other : int
        That it came from by a split, or that it swallowed by a merge; -1 else.
    part : str
    time : float
        In the source's clock [s]; of an end, when it was felt last.
    centre : tuple of 3 float
        Its centre of pressure then, in the link's frame [m].
    """

    kind: Happening
    identity: int
    other: int
    part: str
    time: float
    centre: tuple[float, float, float]


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class TouchEvent(_Answered):
    """A touch that is over.

    Attributes
    ----------
    identity : int
    part, label : str
    confidence : float
        0 to 1; NaN where no classifier named it.
    began, ended : float
        Its first and last sample, in the source's clock [s].
    area, area_least : float
        Skin that felt the touch, and the least of it that was covered, both at their largest [m2].
    peak : float
        Largest pressure of a taxel [counts].
    path_length : float
        Way of its centre along the skin [m].
    centre : (3,) float
        Centre of the load of all its contacts at its heaviest moment, in the link's frame [m].
    contacts : int
        Contacts that were part of it.
    names : tuple of str, optional
        Names that hold the truth as often as was promised, where that was asked for.
    heading : str
        Where it went in the part's axes: "up", "down", "round left", "round right", "to and fro"
        or "still".
    up, right : float
        How far it came in these axes [m].
    speed : float
        While it moved evenly [m/s]; 0 where it stayed.
    presses : int
        How often it was pressed: several of taps and pats.
    period : float
        Mean time between their beginnings [s]; NaN of a single one.
    early : str
        The name that it had while it still went on; empty where it had none. All of it may tell
        better.
    early_after : float
        How long after its beginning that name stood [s].
    channels : tuple of int
        Places of its taxels in the live vector of its part, without stuck ones.
    answers : Answers or None
        Kind, motion and hand; None where no model gives them.
    unfinished : bool
        Whether it was still touched in the last sample: it may have gone on, and its name is the
        one that it had until then.
    """

    identity: int
    part: str
    label: str
    confidence: float
    began: float
    ended: float
    area: float
    peak: float
    path_length: float
    centre: FloatArray
    contacts: int
    names: tuple[str, ...] | None = None
    heading: str = "still"
    up: float = 0.0
    right: float = 0.0
    speed: float = 0.0
    presses: int = 1
    period: float = float("nan")
    early: str = ""
    early_after: float = float("nan")
    channels: tuple[int, ...] = ()
    answers: Answers | None = None
    area_least: float = float("nan")
    unfinished: bool = False

    def __post_init__(self) -> None:
        freeze(self, centre=np.asarray(self.centre, np.float64))

    @property
    def motion(self) -> Answer | None:
        """How it moved."""
        return None if self.answers is None else self.answers.motion

    @property
    def duration(self) -> float:
        """From the first to the last sample [s]."""
        return self.ended - self.began

    def facts(self) -> dict[str, object]:
        """For `repr` and notebooks."""
        return {
            "label": self.label,
            "confidence": f"{self.confidence:.2f}",
            "part": self.part,
            "began": f"{self.began:.3f} s",
            "duration": f"{self.duration:.3f} s",
        }


def taken(queue: deque[Event]) -> list[Event]:
    """All that waits in a queue, which is empty then; others may add to it meanwhile."""
    return [queue.popleft() for _ in range(len(queue))]


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
