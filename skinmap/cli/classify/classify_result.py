"""What `skinmap classify` prints: of a recording, of a touch as it ends, and of a stream."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from skinmap.live.sources.source import Counts
from skinmap.recognition.answers import Answer, HandAnswer
from skinmap.summary import first_few

if TYPE_CHECKING:
    from skinmap.live.contacts.named_touch import TouchEvent
    from skinmap.live.response.loads import ContactForce

MM = 1e3
STATES = {"stuck": "stuck", "noisy": "noisy", "dead": "dead", "unheard": "not heard yet"}
FEW = 8  # channels that a line names
# Of a touch that is over, as they are.
AS_IS = (
    "part", "label", "confidence", "peak", "contacts", "heading", "presses", "kind", "motion",
    "hand", "unfinished",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, slots=True)
class Health:
    """Channels of a part that names are not, or hardly, based on.

    Attributes
    ----------
    stuck
        They hang at a value as if touched, and are left out.
    noisy
        They must be pressed hard to be believed.
    dead
        They feel nothing: by their response calibration, or while all beside them are pressed.
    unheard
        They sent no number, or were not seen at rest yet.
    """

    stuck: list[int]
    noisy: list[int]
    dead: list[int]
    unheard: list[int]


@dataclass(frozen=True, kw_only=True, slots=True)
class ContactLoad:
    """Force and pressure of a touch at its heaviest moment, in the frame of its link.

    Pairs are the ends of the interval of 90 %.

    Attributes
    ----------
    force_n, force_n_90
        Sum of the pressure over the skin [N]; null without an answer.
    vector_n, moment_nm
        Force on the skin [N], and its moment about `centre_m` [N m]; null without an answer.
    normal
        Outward direction against the force; null without an answer.
    centre_m
        [m]; null without an answer.
    area_mm2, area_mm2_90
        Touched skin [mm2]; null without an answer.
    mean_kpa, mean_kpa_90, peak_kpa, peak_kpa_90
        Pressures [kPa]; null without an answer.
    refused
        Reason for a missing answer; empty where there is one.
    """

    force_n: float | None
    force_n_90: list[float] | None
    vector_n: list[float] | None
    moment_nm: list[float] | None
    normal: list[float] | None
    centre_m: list[float] | None
    area_mm2: float | None
    area_mm2_90: list[float] | None
    mean_kpa: float | None
    mean_kpa_90: list[float] | None
    peak_kpa: float | None
    peak_kpa_90: list[float] | None
    refused: str


@dataclass(frozen=True, kw_only=True, slots=True)
class NamedTouchRow:
    """A touch with its name and its motion.

    Attributes
    ----------
    touch
        Number of the touch.
    part
        Name of the part.
    label
        Label of the touch.
    names
        With `--coverage`, the names that hold the truth as often, the likeliest first; none of
        them where no name is likely enough. Else null.
    channels
        Places of its taxels in the live vector of the part; stuck ones are left out.
    heading
        Direction in the axes of the part: up, down, round left or right as seen facing
        the skin, to and fro, or still.
    up_mm
        Displacement along the up axis of the part.
    right_mm
        Displacement along the right axis of the part.
    speed_mm_s
        While it moved evenly; 0 where it stayed.
    presses
        Number of separate presses.
    kind, motion, hand
        With what, how it moved, and whether it was a hand; null where it was too short to be named.
    load
        Force and pressures, with `--calibration`; else null.
    """

    touch: int
    part: str
    label: str
    names: list[str] | None
    channels: list[int]
    heading: str
    up_mm: float
    right_mm: float
    speed_mm_s: float
    presses: int
    kind: Answer | None
    motion: Answer | None
    hand: HandAnswer | None
    load: ContactLoad | None


@dataclass(frozen=True, kw_only=True, slots=True)
class NamedRow(NamedTouchRow):
    """A touch of a recording.

    Attributes
    ----------
    event
        Number of the recorded event.
    touch
        Among those of the event; 0 is the heaviest.
    label
        The name given; `no_contact` and `unknown` too.
    confidence
        Confidence in the label, 0 to 1.
    recorded_label
        The name that it was recorded with.
    channels
        Places of its taxels in the live vector of the part.
    up_mm
        Displacement along the up axis of the part, in the longest press.
    right_mm
        Displacement along the right axis of the part, in the longest press.
    way_mm
        Length of the course of the centre along the skin; 0 where it stayed.
    speed_mm_s
        Speed of the centre along the skin; 0 where it stayed.
    period_ms
        Time between presses; null for a single press.
    twist_deg
        Turn of the contact about its normal.
    kind, motion, hand
        With what, how it moved, and whether it was a hand; null where nothing was touched.
    """

    event: int
    confidence: float
    recorded_label: str
    way_mm: float
    period_ms: float | None
    twist_deg: float

    @property
    def force(self) -> str:
        """Newtons with their interval, or why there are none; empty without a calibration."""
        if self.load is None:
            return ""
        if self.load.force_n is None or self.load.force_n_90 is None:
            return self.load.refused
        return "{:.3g} N ({:.3g} to {:.3g})".format(self.load.force_n, *self.load.force_n_90)


@dataclass(frozen=True, kw_only=True, slots=True)
class NameSets:
    """Sets of names, compared with their promise.

    Attributes
    ----------
    coverage
        Promised share of sets that hold the true name.
    held
        Share of touches whose set held the recorded name; null without touches.
    mean_size
        Names in a set; null without touches.
    """

    coverage: float
    held: float | None
    mean_size: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class ClassifyResult:
    """The touches of a recording, named.

    Attributes
    ----------
    classifier
        Name of the classifier.
    touches
        One row for each recorded event.
    events
        Number of recorded events.
    accuracy
        Share of events of which every touch got its name; null without events.
    sets
        With `--coverage`; else null.
    health
        By part; parts whose taxels are all well are left out.
    """

    classifier: str
    touches: list[NamedRow]
    events: int
    accuracy: float | None
    sets: NameSets | None
    health: dict[str, Health]


@dataclass(frozen=True, kw_only=True, slots=True)
class LiveTouch(NamedTouchRow):
    """A line for each touch of a live source, when it is over.

    Attributes
    ----------
    event
        Kind of the line, always `touch`.
    confidence
        0 to 1; null where it was too short to be named.
    start_s, duration_s
        In the source's clock.
    area_mm2, area_least_mm2
        Largest area of skin that felt the touch, and the area that it covered at least.
    path_mm
        Length of the course of the centre along the skin.
    peak
        Largest pressure of a taxel [counts].
    centre_mm
        Centre of its load at its heaviest moment, in the frame of the link.
    contacts
        Numbers of the contacts in the touch.
    period_s
        Mean time between presses; null for a single press.
    early_label, early_s
        The name that it had while it went on, and how long after its beginning that stood; null
        where it had none.
    unfinished
        Whether it was still touched when the samples ended: its name is the one until then.
    """

    event: Literal["touch"] = "touch"
    confidence: float | None
    start_s: float
    duration_s: float
    area_mm2: float
    area_least_mm2: float
    path_mm: float
    peak: float
    centre_mm: list[float]
    contacts: int
    period_s: float | None
    early_label: str | None
    early_s: float | None
    unfinished: bool

    @classmethod
    def of(cls, touch: TouchEvent, load: ContactForce | None = None) -> LiveTouch:
        """What is printed of a touch that is over, and of its heaviest force."""
        return cls(
            touch=touch.identity,
            names=None if touch.names is None else list(touch.names),
            start_s=touch.began,
            duration_s=touch.duration,
            area_mm2=touch.area * MM**2,
            area_least_mm2=touch.area_least * MM**2,
            path_mm=touch.path_length * MM,
            centre_mm=(touch.centre * MM).tolist(),
            up_mm=touch.up * MM,
            right_mm=touch.right * MM,
            speed_mm_s=touch.speed * MM,
            period_s=touch.period if touch.presses > 1 else None,
            early_label=touch.early or None,
            early_s=touch.early_after if touch.early else None,
            channels=list(touch.channels),
            load=None if load is None else ContactLoad(**load.plain()),
            **{name: getattr(touch, name) for name in AS_IS},
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Latency:
    """From the arrival of a sample to its labels.

    Attributes
    ----------
    median, p99, max
        In milliseconds; null where no sample came. Samples of a recording wait for those read with
        them.
    """

    median: float | None
    p99: float | None
    max: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class LiveSummary:
    """The last line of a live source.

    Attributes
    ----------
    event
        Kind of the line, always `summary`.
    source, classifier
        As given, and the model's name.
    parts
        Names of the followed parts.
    touches
        Number of finished touches.
    withdrawn
        Number of touches taken back because their taxels were stuck.
    seconds
        From first to last sample; null where none came.
    rate_hz
        Rate stated by the source; null where it states none.
    latency_ms
        Delay from a sample to its labels.
    counts
        Counts of samples by their fate.
    health
        By part; parts whose taxels are all well are left out.
    """

    event: Literal["summary"] = "summary"
    source: str
    classifier: str
    parts: list[str]
    touches: int
    withdrawn: int
    seconds: float | None
    rate_hz: float | None
    latency_ms: Latency
    counts: Counts
    health: dict[str, Health]


def health_lines(health: Mapping[str, Health]) -> Iterator[str]:
    """One line for each kind of ill taxels of a part."""
    for part, found in health.items():
        for state, words in STATES.items():
            channels = getattr(found, state)
            if channels:
                yield f"{part}: {len(channels)} {words} (channels {first_few(channels, FEW)})"
