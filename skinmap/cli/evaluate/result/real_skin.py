"""The protocols `fingers` and `hands`: touches of a real skin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from skinmap.cli.evaluate.result.shared import RealSkin


@dataclass(frozen=True, kw_only=True, slots=True)
class CountRow:
    """A way to count fingers.

    Attributes
    ----------
    method
        What counts.
    exact, within_one
        Share of the recordings that it was not fitted on.
    spread
        Standard deviation of `exact` over the repetitions.
    control, control_within_one
        The same on the first samples of each recording, before it is touched.
    confusion
        Recordings of each number of fingers (rows) by the number counted.
    """

    method: str
    exact: float
    within_one: float
    spread: float
    control: float
    control_within_one: float
    confusion: list[list[float]]


@dataclass(frozen=True, kw_only=True, slots=True)
class FingersResult(RealSkin):
    """The protocol `fingers`: real fingers, counted.

    Attributes
    ----------
    recordings
        By number of fingers.
    majority
        Share of the most frequent number.
    seeds
        Of the repetitions.
    first_samples
        Of the control.
    narrow_mm, finger_mm
        Spread across one finger at most, and what each further one adds: chosen on a third of the
        recordings, median over the repetitions.
    live
        Contacts of the live tracker in the heaviest sample; nothing is fitted.
    width
        Without training: two lengths from a third of the recordings, judged on the others.
    chosen, chosen_numbers
        The same where the third chooses which number of contact geometry counts, too: nothing of
        the rule is known from the recordings that judge it. And what it chose, of each seed.
    trained
        Extra trees on contact geometry, a region of the skin left out in turn.
    """

    protocol: Literal["fingers"] = "fingers"
    recordings: dict[str, int]
    majority: float
    seeds: list[int]
    first_samples: int
    narrow_mm: float
    finger_mm: float
    live: CountRow
    width: CountRow
    chosen: CountRow
    chosen_numbers: list[str]
    trained: CountRow


@dataclass(frozen=True, kw_only=True, slots=True)
class HandRow:
    """How well a method tells hands from all else, grasps left out.

    Attributes
    ----------
    method
        Its name.
    mean, spread
        Mean of the diagonal, and its standard deviation over the repetitions.
    """

    method: str
    mean: float
    spread: float


@dataclass(frozen=True, kw_only=True, slots=True)
class HandsResult(RealSkin):
    """The protocol `hands`: real hands on a skin.

    Attributes
    ----------
    flips, edge_error_percent
        Of the flat map that contact images lie on.
    samples, grasping
        All, and those with more than 30 active taxels.
    contacts_median, contacts_quartiles
        Contacts of the live tracker in samples that grasp.
    pieces_median
        Connected active taxels in the same samples, specks and all.
    single_taxels
        Contacts of one taxel, mean of these samples.
    quiet_contacts
        Contacts in samples with three active taxels at most: the control; null without any.
    hand_or_not
        By method; empty where it is not said which samples are of a hand.
    skipped
        What was left out, and why.
    """

    protocol: Literal["hands"] = "hands"
    flips: int
    edge_error_percent: float
    samples: int
    grasping: int
    contacts_median: float
    contacts_quartiles: list[float]
    pieces_median: float
    single_taxels: float
    quiet_contacts: float | None
    hand_or_not: list[HandRow]
    skipped: dict[str, str]
