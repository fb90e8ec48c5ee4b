"""What the viewer's commands print, and the layers that they are asked for by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

# Here, as `viewer.layers`, which makes them, takes a second to import.
LAYERS = (
    "pressure", "raw", "binary", "structures", "uncertainty", "distortion", "health", "patches",
    "touched", "changed", "difference",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, slots=True)
class EdgeError:
    """Root mean square change of edge lengths of patches.

    Attributes
    ----------
    median
        Of the patches [%].
    max
        Of the worst patch [%].
    """

    median: float
    max: float


@dataclass(frozen=True, kw_only=True, slots=True)
class NormalFit:
    """Normals of taxels against the mesh of their link.

    Attributes
    ----------
    median_deg
        Median angle between both normals.
    share_within_15_deg
        Share of the taxels within 15 degrees.
    inward
        Taxels whose normal points into the body.
    """

    median_deg: float
    share_within_15_deg: float
    inward: int


@dataclass(frozen=True, kw_only=True, slots=True)
class StructureCounts:
    """Counts of neighbourhood structures.

    Attributes
    ----------
    plain
        Told apart as they lie.
    rotated
        Told apart up to a turn.
    """

    plain: int
    rotated: int


@dataclass(frozen=True, kw_only=True, slots=True)
class TouchCounts:
    """Counts of simulated touches.

    Attributes
    ----------
    train
        Number of training touches.
    same_parts
        Tested, on the parts that were trained on.
    other_parts
        Tested, on parts never trained on.
    """

    train: int
    same_parts: int
    other_parts: int


@dataclass(frozen=True, kw_only=True, slots=True)
class DemoAccuracy:
    """Share of simulated touches that are named right.

    Attributes
    ----------
    same_parts
        On the parts that were trained on.
    other_parts
        On parts never trained on.
    other_parts_histogram
        There, by histograms of structures.
    other_parts_paper
        There, by the paper's literal histograms.
    """

    same_parts: float
    other_parts: float
    other_parts_histogram: float
    other_parts_paper: float


@dataclass(frozen=True, kw_only=True, slots=True)
class ScoreRow:
    """One classifier on one test.

    Attributes
    ----------
    classifier
        Name of the classifier.
    tested_on
        Parts that were trained on, or others.
    accuracy
        Share of touches named right.
    touches
        Number of tested touches.
    per_label
        The accuracy by gesture.
    """

    classifier: str
    tested_on: str
    accuracy: float
    touches: int
    per_label: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, slots=True)
class DemoResult:
    """The whole thread on the real iCub.

    Attributes
    ----------
    robot
        Name of the robot.
    parts
        Names of all parts.
    taxels
        Total number of taxels.
    meshed_taxels
        Number of taxels in a surface mesh.
    patches
        Number of connected sheets.
    flips
        Flipped triangles of all flat maps.
    edge_rms_percent
        Error of the flat maps.
    normals
        Normals compared with the body.
    structures
        Numbers of neighbourhood structures.
    accuracy_is
        Origin of the touches: always simulated.
    trained_on
        Parts of the training.
    touches
        Numbers of simulated touches.
    accuracy
        Accuracy of the names.
    table
        A row for each classifier and test.
    seed
        Seed of all randomness.
    files
        Names of the files inside `--out`.
    seconds
        Time of the whole demo.
    """

    robot: str
    parts: list[str]
    taxels: int
    meshed_taxels: int
    patches: int
    flips: int
    edge_rms_percent: EdgeError
    normals: NormalFit
    structures: StructureCounts
    accuracy_is: Literal["simulated"]
    trained_on: list[str]
    touches: TouchCounts
    accuracy: DemoAccuracy
    table: list[ScoreRow]
    seed: int
    files: list[str]
    seconds: float


@dataclass(frozen=True, kw_only=True, slots=True)
class ShownTouch:
    """A touch in the picture.

    Attributes
    ----------
    part
        Name of the part.
    label
        Label of the touch.
    confidence
        0 to 1; null where it was not named yet.
    """

    part: str
    label: str
    confidence: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class ChangedTouch:
    """A touch of two recordings side by side.

    Attributes
    ----------
    part
        Name of the part.
    left, right
        Its name in each; null where it is not touched there.
    moved_mm
        From its place at the left to that at the right; null for a touch of one only.
    """

    part: str
    left: str | None
    right: str | None
    moved_mm: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class Difference:
    """Right recording minus the left one, of two shown side by side.

    Attributes
    ----------
    parts
        Of the same skin in both.
    taxels
        Number of taxels that differ by more than the noise at rest.
    mean, largest
        Of the absolute differences, in the layer's unit.
    touches
        Paired touches of both recordings.
    """

    parts: list[str]
    taxels: int
    mean: float
    largest: float
    touches: list[ChangedTouch]


@dataclass(frozen=True, kw_only=True, slots=True)
class Beside:
    """Content of the right half of two side by side.

    Attributes
    ----------
    robot, source, touches
        As of the left one.
    time
        Time of the picture from the source's beginning [s]; null without samples.
    difference
        Null where the two have no skin in common.
    note
        Why there is none; else empty.
    """

    robot: str
    source: str
    time: float | None
    touches: list[ShownTouch]
    difference: Difference | None
    note: str


@dataclass(frozen=True, kw_only=True, slots=True)
class ViewFiles:
    """Pictures, movies, scenes or pages of touches on the body.

    Attributes
    ----------
    robot
        Name of the robot.
    parts
        Names of the shown parts.
    source
        Source of the samples.
    time
        Time of the picture from the source's beginning [s], as `--at`; null without
        samples.
    touches
        Touches in the picture.
    files
        Names of the written files.
    beside
        The other one of two; null without `--beside`.
    """

    robot: str
    parts: list[str]
    source: str
    time: float | None
    touches: list[ShownTouch]
    files: list[Path] = field(default_factory=list)
    beside: Beside | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class ViewWindow:
    """A window that was closed.

    Attributes
    ----------
    robot
        Name of the robot.
    parts
        Names of the shown parts.
    drawn
        Number of drawn pictures.
    """

    robot: str
    parts: list[str]
    drawn: int


@dataclass(frozen=True, kw_only=True, slots=True)
class ViewPage:
    """A page that was served.

    Attributes
    ----------
    robot
        Name of the robot.
    parts
        Names of the shown parts.
    address
        Address of the page.
    """

    robot: str
    parts: list[str]
    address: str
