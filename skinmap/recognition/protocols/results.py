"""Rows and results of the protocols of `skinmap evaluate`: what they measured, field by field."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from msgspec import UNSET, UnsetType

Kind = Literal["plain", "event"]
Meaning = Literal["yes", "no", "doubtful"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Evaluated:
    """Result of one protocol.

    Attributes
    ----------
    protocol
        Name of the protocol.
    robot
        Name of the robot.
    files
        Names of the files inside `--out`.
    """

    protocol: str
    robot: str
    files: list[str] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True, slots=True)
class Simulated(Evaluated):
    """Result on simulated touches.

    Attributes
    ----------
    accuracy_is
        Origin of the touches.
    variety
        Random spread of touches and sensors, 0 to 2; 0 means pads of fixed sizes on clean
        sensors.
    seeds
        Seeds of the repetitions.
    """

    accuracy_is: Literal["simulated"] = "simulated"
    variety: float
    seeds: list[int]


@dataclass(frozen=True, kw_only=True, slots=True)
class SimulatedGestures(Simulated):
    """Result on equal numbers of simulated touches of each gesture.

    Attributes
    ----------
    gestures
        Names of the gestures to distinguish.
    per_gesture
        Number of touches of each gesture on each part or patch, in each physics.
    """

    gestures: list[str]
    per_gesture: int


@dataclass(frozen=True, kw_only=True, slots=True)
class RealSkin(Evaluated):
    """Result on samples of a real skin.

    Attributes
    ----------
    taxels
        Number of taxels of the skin.
    archive, patch
        Files of the samples and of the skin.
    accuracy_is
        Origin of the touches.
    unplaced, unrecorded
        Channels without a place, and taxels without a channel.
    """

    taxels: int
    archive: str
    patch: str
    accuracy_is: Literal["real"] = "real"
    unplaced: int
    unrecorded: int


@dataclass(frozen=True, kw_only=True, slots=True)
class AccuracyRow:
    """One classifier under one kind of cross-validation.

    Attributes
    ----------
    percent
        kaspar: share of the samples that was drawn.
    folds
        Plain as published, or by touch event, so that no event is in both halves.
    features
        Features that the classifier reads.
    classifier
        Name of the classifier.
    per_class
        Share named right, by label.
    mean
        Mean over the classes.
    std
        Of the mean over the seeds; not of published figures.
    samples
        Number of tested samples (kaspar).
    touches
        Number of tested touch events (recordings).
    """

    percent: int | UnsetType = UNSET
    folds: Kind
    features: str
    classifier: str
    per_class: dict[str, float]
    mean: float
    std: float | UnsetType = UNSET
    samples: int | UnsetType = UNSET
    touches: int | UnsetType = UNSET


@dataclass(frozen=True, kw_only=True, slots=True)
class CarrySummary:
    """Accuracy of some features on other patches.

    Attributes
    ----------
    features
        Features that the classifier reads.
    same, other
        Accuracy on the patch trained on and on the others; null where there is none.
    difference
        Other less same; null without others.
    worst
        Accuracy of the worst pair of patches; null without others.
    worst_pair
        Trained on and tested on; empty without others.
    """

    features: str
    same: float | None
    other: float | None
    difference: float | None
    worst: float | None
    worst_pair: list[str]


@dataclass(frozen=True, kw_only=True, slots=True)
class CarryRow:
    """One pair of patches.

    Attributes
    ----------
    features
        Features that the classifier reads.
    trained_on
        Patch of the training.
    tested_on
        Patch of the test.
    taxels
        Numbers of taxels of both patches.
    accuracy
        Share named right, by event.
    """

    features: str
    trained_on: str
    tested_on: str
    taxels: list[int]
    accuracy: float


@dataclass(frozen=True, kw_only=True, slots=True)
class CarryOver:
    """Training on one patch, testing on another with other numbers of taxels.

    Attributes
    ----------
    percent
        Share of the samples that was drawn.
    summary
        One row for each kind of features.
    rows
        One row for each pair of patches.
    left_out
        Parts on which not every touch can be simulated.
    """

    percent: int
    summary: list[CarrySummary]
    rows: list[CarryRow]
    left_out: list[str]


@dataclass(frozen=True, kw_only=True, slots=True)
class SweepRow:
    """Histograms with one radius and number of codewords.

    Attributes
    ----------
    radius_mm, words
        Of a neighbourhood, and codewords of a structure.
    structures
        Number of different structures.
    neighbours
        Number of neighbours of most taxels.
    bins
        Number of bins of the histogram.
    mean, std
        Mean of the classes, and its spread over the seeds.
    """

    radius_mm: float
    words: int
    structures: int
    neighbours: int
    bins: int
    mean: float
    std: float


@dataclass(frozen=True, kw_only=True, slots=True)
class MarginRow:
    """Lead of histograms over raw values in an RBF SVM.

    Attributes
    ----------
    percent, folds, features
        Share of the samples, how they were dealt out, and which histograms.
    points
        Difference of the means of the classes [points].
    paper
        The published difference, on real recordings; null where there is none.
    """

    percent: int
    folds: str
    features: str
    points: float
    paper: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class KasparResult(Simulated):
    """Result of the protocol `kaspar`.

    Attributes
    ----------
    part
        Name of the part.
    taxels
        Total number of taxels.
    places
        Choice of the touched places.
    sampling
        Choice of the drawn samples: at random, or every 50th and 10th as published.
    samples
        Number of samples of each gesture.
    table
        One row for each pair of features and classifier.
    margins
        Histograms ahead of raw values, beside the published margin.
    paper
        Figures published in the paper.
    carry_over
        Training and test on different patches.
    sweep
        Of radius and codewords; empty without `--set sweep=yes` or `--out`.
    """

    protocol: Literal["kaspar"] = "kaspar"
    part: str
    taxels: int
    places: str
    sampling: str | UnsetType = UNSET
    samples: dict[str, int]
    table: list[AccuracyRow]
    margins: list[MarginRow] | UnsetType = UNSET
    paper: list[AccuracyRow]
    carry_over: CarryOver
    sweep: list[SweepRow]


@dataclass(frozen=True, kw_only=True, slots=True)
class SplitSpread:
    """Mean of the diagonal of the confusion matrix over the splits.

    Attributes
    ----------
    mean
        Mean over the splits, 0 to 1.
    min
        Least value over the splits, 0 to 1.
    max
        Largest value over the splits, 0 to 1.
    confusion
        Mean shares: rows are the touches, columns the names they got; not in older files.
    """

    mean: float
    min: float
    max: float
    confusion: list[list[float]] | UnsetType = UNSET


@dataclass(frozen=True, kw_only=True, slots=True)
class MethodResult:
    """One method of the protocol `baxter`.

    Attributes
    ----------
    missing
        Name of a library that is not installed; the other fields are then absent.
    mean, min, max
        Mean of the diagonal over the splits, by touch.
    plain
        The same for splits as published.
    tuning
        Settings tried on the first split with their means, and the paper's where it prints one.
    chosen
        The settings of each split by touch.
    k
        Number of codewords (bovw).
    network, learning_rate, epochs
        cnn: its size and training.
    C, gamma
        raw_rbf: penalty and width.
    """

    missing: str | UnsetType = UNSET
    mean: float | UnsetType = UNSET
    min: float | UnsetType = UNSET
    max: float | UnsetType = UNSET
    plain: SplitSpread | UnsetType = UNSET
    tuning: list[dict[str, Any]] | UnsetType = UNSET
    chosen: list[dict[str, Any]] | UnsetType = UNSET
    k: int | UnsetType = UNSET
    network: str | UnsetType = UNSET
    learning_rate: float | UnsetType = UNSET
    epochs: int | UnsetType = UNSET
    C: float | UnsetType = UNSET
    gamma: float | UnsetType = UNSET


@dataclass(frozen=True, kw_only=True, slots=True)
class Confusion:
    """Mean confusion matrices: rows are what a touch was, columns what it was named.

    Attributes
    ----------
    labels
        Of rows and columns.
    bovw, cnn, raw_rbf
        Of each method that ran.
    """

    labels: list[str]
    bovw: list[list[float]] | UnsetType = UNSET
    cnn: list[list[float]] | UnsetType = UNSET
    raw_rbf: list[list[float]] | UnsetType = UNSET


@dataclass(frozen=True, kw_only=True, slots=True)
class BaxterResult(Evaluated):
    """Result of the protocol `baxter`.

    Attributes
    ----------
    part
        Name of the part.
    taxels
        Total number of taxels.
    accuracy_is
        Origin of the touches.
    simulated
        Whether the touches are simulated.
    variety
        Random spread of touches and sensors, 0 to 2.
    bovw, cnn, raw_rbf
        Bags of visual words, a network, raw values; those that were asked for.
    confusion
        Confusion matrix by method.
    images
        Total number of images.
    touches
        Total number of touches.
    repeats
        Number of repeats; each is a split into 70 and 30 %.
    seed
        Seed of all randomness.
    network
        The paper's size, or a smaller one.
    paper
        The published figures, by method.
    """

    protocol: Literal["baxter"] = "baxter"
    part: str
    taxels: int
    accuracy_is: Literal["simulated", "recorded"] = "simulated"
    variety: float
    bovw: MethodResult | UnsetType = UNSET
    cnn: MethodResult | UnsetType = UNSET
    raw_rbf: MethodResult | UnsetType = UNSET
    confusion: Confusion
    images: int
    touches: int
    repeats: int
    seed: int
    network: str
    paper: dict[str, dict[str, float]]
    simulated: bool = True


@dataclass(frozen=True, kw_only=True, slots=True)
class PatchesRow:
    """One classifier on patches that it was not trained on.

    Attributes
    ----------
    features
        Features that the classifier reads.
    classifier
        Name of the classifier.
    mean, std
        Share named right, and its spread over the seeds.
    worst, worst_patch
        On the patch that it does worst on.
    per_patch, per_class
        By patch, and by gesture.
    unknown
        Share that the classifier would leave unnamed.
    touches
        Number of tested touches.
    """

    features: str
    classifier: str
    mean: float
    std: float
    worst: float
    worst_patch: str
    per_patch: dict[str, float]
    per_class: dict[str, float]
    unknown: float
    touches: int


@dataclass(frozen=True, kw_only=True, slots=True)
class CrossPatchResult(SimulatedGestures):
    """Result of the protocol `cross-patch`.

    Attributes
    ----------
    train_robot
        Robot trained on; null: all other patches of the same.
    patches
        Number of taxels by patch.
    rows
        One row for each classifier.
    """

    protocol: Literal["cross-patch"] = "cross-patch"
    train_robot: str | None
    patches: dict[str, int]
    rows: list[PatchesRow]


@dataclass(frozen=True, kw_only=True, slots=True)
class PhysicsRow:
    """A classifier trained on one physics and tested on one, on other parts.

    Attributes
    ----------
    trained_on, tested_on
        Ours, a variant of MuJoCo, or all of both but what is tested on.
    mean, per_class
        Share named right: mean of the gestures, and each.
    ece
        Expected calibration error of the confidences.
    held, set_size
        Share of the touches whose set of names, promised for 0.9 of them, holds the true one, and
        names in a set; null for classifiers without sets.
    confusion
        Touches of each gesture by the name they were given.
    """

    trained_on: str
    tested_on: str
    mean: float
    per_class: dict[str, float]
    ece: float
    held: float | None
    set_size: float | None
    confusion: dict[str, dict[str, int]]


@dataclass(frozen=True, kw_only=True, slots=True)
class PhysicsResult(SimulatedGestures):
    """Result of the protocol `physics`.

    Attributes
    ----------
    parts
        Names of the parts, without mirror images.
    classifier
        Name of the classifier.
    frozen
        The variant that nothing is trained or tuned on.
    rows
        By training and test.
    """

    protocol: Literal["physics"] = "physics"
    parts: list[str]
    classifier: str
    frozen: str
    rows: list[PhysicsRow]


@dataclass(frozen=True, kw_only=True, slots=True)
class SeenRow:
    """A classifier of touches in time, trained on other parts and other people.

    Attributes
    ----------
    features
        Features that the classifier reads: contact geometry alone, or with motion.
    tested_on
        Ours, or a variant of MuJoCo.
    seen
        Share of each touch that it was shown.
    mean, per_class
        Share named right: mean of the gestures, and each.
    confusion
        Touches of each gesture by the name they were given.
    """

    features: str
    tested_on: str
    seen: float
    mean: float
    per_class: dict[str, float]
    confusion: dict[str, dict[str, int]]


@dataclass(frozen=True, kw_only=True, slots=True)
class StrokesRow:
    """Median errors of the motion of strokes of 5 cm or more.

    Attributes
    ----------
    physics
        Ours, or a variant of MuJoCo.
    strokes
        Number of judged strokes.
    speed
        Error of the speed as a share of it; this and the others are null without strokes.
    speed_bias
        The same with its sign, or null.
    direction_deg
        Angle between velocities and true ones, or null.
    length
        Error of the length of the way, as a share of it, or null.
    within
        Share of the velocities that are wrong by no more than twice their stated error, or null.
    """

    physics: str
    strokes: int
    speed: float | None
    speed_bias: float | None
    direction_deg: float | None
    length: float | None
    within: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeResult(SimulatedGestures):
    """Result of the protocol `time`.

    Attributes
    ----------
    parts
        Names of the parts, without mirror images.
    per_gesture
        Touches of each on each part; of MuJoCo's a quarter.
    rows
        By features, physics and share seen.
    strokes
        Direction and speed, by physics.
    presses_right
        Share of taps and pats whose presses were counted right, by physics; null without any.
    still_alone, still_together
        Share of the four still gestures named right by a classifier of these alone, and of all.
    gained_points
        By motion, of whole touches.
    half_seen
        Accuracy on half of a touch, as a share of that on all of it.
    skipped
        Parts left out, with the reasons.
    """

    protocol: Literal["time"] = "time"
    parts: list[str]
    rows: list[SeenRow]
    strokes: list[StrokesRow]
    presses_right: dict[str, float | None]
    still_alone: float
    still_together: float
    gained_points: float
    half_seen: float
    skipped: dict[str, str]


@dataclass(frozen=True, kw_only=True, slots=True)
class CountRow:
    """A way to count fingers.

    Attributes
    ----------
    method
        Name of the counting method.
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
        Seeds of the repetitions.
    first_samples
        Number of samples of the control.
    live
        Contacts of the live tracker in the heaviest sample; nothing is fitted.
    chosen, chosen_numbers
        Without training: a number of contact geometry and two thresholds chosen on a third of the
        recordings, judged on the others; and which number it was, of each seed.
    trained
        Extra trees on contact geometry, a region of the skin left out in turn.
    """

    protocol: Literal["fingers"] = "fingers"
    recordings: dict[str, int]
    majority: float
    seeds: list[int]
    first_samples: int
    live: CountRow
    chosen: CountRow
    chosen_numbers: list[str]
    trained: CountRow


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


@dataclass(frozen=True, kw_only=True, slots=True)
class PrintsResult(Evaluated):
    """The protocol `prints`: areas of contacts on a grid of readings.

    Attributes
    ----------
    train
        File of the training prints.
    test
        File of the tested prints.
    people
        People in the training.
    images, contacts
        Tested: images, and contacts found in their readings alone.
    judged
        Contacts with a print. All that follows is null without any.
    missed
        Prints without a contact.
    area_error_median, area_error_p90
        Error of the area as a share of the true one: median and 90th percentile; null without
        prints.
    centre_mm_median
        Distance from the centre of the print [mm], median; null without prints.
    holds
        Share of the true areas inside their interval of 90 %; null without prints.
    high_to_low
        Upper end of the interval through its lower end, median; null without prints.
    own_area_error_median
        Median error where ten prints of each person set this person's scale; null without `person`.
    """

    protocol: Literal["prints"] = "prints"
    train: str
    test: str
    people: int
    images: int
    contacts: int
    judged: int
    missed: int
    area_error_median: float | None
    area_error_p90: float | None
    centre_mm_median: float | None
    holds: float | None
    high_to_low: float | None
    own_area_error_median: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class ForceRow:
    """Total normal forces of some touches.

    Attributes
    ----------
    name
        Body or part, or `all`.
    touches
        Number of pressed touches.
    judged
        Number of touches with an answer.
    beyond
        Share whose heaviest moment lies above the calibrated range: an earlier one is judged.
    force_n_median
        True force [N]; null without judged touches.
    bias
        Median of our force through the true one, less 1; null without judged touches.
    error_median, error_p95
        Error as a share of the true force: median and 95th percentile; null without judged touches.
    plain_error_median
        The control: pressures times the areas of active taxels; null without judged touches.
    direction_deg_median
        Angle between our force and the true one [deg]; null without judged touches.
    holds
        Share of the true forces inside their interval of 90 %; null without judged touches.
    area_error_median
        Error of the area as a share of the area of the pressed springs; null without judged
        touches.
    area_holds
        Share of these areas inside their interval; null without judged touches.
    bounds_hold
        Share of them between the least and the most by counts alone; null without judged touches.
    """

    name: str
    touches: int
    judged: int
    beyond: float
    force_n_median: float | None
    bias: float | None
    error_median: float | None
    error_p95: float | None
    plain_error_median: float | None
    direction_deg_median: float | None
    holds: float | None
    area_error_median: float | None
    area_holds: float | None
    bounds_hold: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class ForceResult(Evaluated):
    """The protocol `force`: forces of contacts against those of MuJoCo.

    Attributes
    ----------
    parts
        Judged. The width of the intervals comes from other parts and other variants.
    bodies
        Names of the pressing bodies.
    per_body
        Number of presses of each body on each part.
    physics
        Variant that nothing is tuned on.
    seeds
        Seeds of the repetitions.
    all, by_body, by_part
        Errors of the force.
    by_range
        Errors of touches that stay within the calibrated range, and of those that leave it.
    """

    protocol: Literal["force"] = "force"
    parts: list[str]
    bodies: list[str]
    per_body: int
    physics: str
    seeds: list[int]
    all: ForceRow
    by_body: list[ForceRow]
    by_part: list[ForceRow]
    by_range: list[ForceRow]


@dataclass(frozen=True, kw_only=True, slots=True)
class LoadRow:
    """Pressures of one recording beside its reference.

    Attributes
    ----------
    recording
        File of the recording.
    rms_bar
        Root mean square error of a taxel, mean of the answered ones [bar]; null without a
        reference, as `holds`.
    holds
        Share of the answers whose interval of 90 % holds the reference; null without one.
    width_bar
        Mean width of the intervals [bar]; null without answers.
    refused
        Share of the answers that were refused: taxels that are left out, and pressures above the
        calibrated range.
    answered
        Taxels that answered at least once.
    zeroed
        Whether the recording had a rest before load that set its zero.
    zero_age_seconds
        Age of the zero at the first sample; null where it came from the calibration and the times
        of the recording are not those of a calendar.
    unexplained
        Share of the reference that the skin leaves open once both clocks are aligned; null
        without one, or where they cannot be aligned.
    reason
        Why a reference was not used; empty where it was, or where there is none.
    """

    recording: str
    rms_bar: float | None
    holds: float | None
    width_bar: float | None
    refused: float
    answered: int
    zeroed: bool
    zero_age_seconds: float | None
    unexplained: float | None
    reason: str

    @property
    def zero(self) -> str:
        """Whose zero it was, in words."""
        if self.zeroed or self.zero_age_seconds is None:
            return "its own" if self.zeroed else "the calibration's"
        return f"the calibration's, {self.zero_age_seconds / 3600.0:.1f} h old"


@dataclass(frozen=True, kw_only=True, slots=True)
class LoadsResult(Evaluated):
    """The protocol `load`: pressures of taxels beside those of a chamber.

    Attributes
    ----------
    model
        Step of the ladder that the calibration took.
    taxels, calibrated
        All, and those that the calibration answers.
    rows
        One for each recording.
    """

    protocol: Literal["load"] = "load"
    model: str
    taxels: int
    calibrated: int
    rows: list[LoadRow]


@dataclass(frozen=True, kw_only=True, slots=True)
class LeakRow:
    """Points by which plain folds flatter a classifier.

    Attributes
    ----------
    classifier, points
        Its name, and percentage points.
    """

    classifier: str
    points: float


@dataclass(frozen=True, kw_only=True, slots=True)
class LeftOutRow:
    """One classifier, judged on groups of touches that it did not learn from.

    Attributes
    ----------
    classifier
        Name of the classifier.
    left_out
        event: touches dealt out whatever group they are of; else session, person, place or part.
    groups
        Number of left-out groups.
    per_class
        Share named right, by label.
    mean
        Of the classes; null where nothing could be left out.
    right
        Share of all touches named right; null likewise.
    chance
        Share of the most frequent label.
    control, first
        Share named right by the same classifier of what the skin read before the touches, and of
        the first samples; null where it sees nothing there.
    raw
        Accuracy of a linear classifier on raw values before the touches; null where there
        are none.
    meaning
        Whether the figure measures touches; null without a figure.
    verdict
        Verdict in one line, or the reason for a missing figure.
    """

    classifier: str
    left_out: str
    groups: int
    chance: float
    per_class: dict[str, float] = field(default_factory=dict)
    mean: float | None = None
    right: float | None = None
    control: float | None = None
    first: float | None = None
    raw: float | None = None
    meaning: Meaning | None = None
    verdict: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordingsResult(Evaluated):
    """Result of cross-validated recordings.

    Attributes
    ----------
    parts
        Names of the parts.
    recordings
        Files of the recordings.
    folds
        Number of folds of the cross-validation.
    seeds
        Seeds of the cross-validation.
    touches
        Number of events by label.
    table
        By classifier and kind of folds.
    leak
        One row for each classifier.
    left_out
        With --leave-out: what is left of the figures, and their controls.
    sessions, people
        Touches of each; people who are not named are left out.
    warnings
        Leaks that a classifier may have learnt instead of the touches.
    skipped
        Classifiers that were left out, and why.
    """

    protocol: Literal["recordings"] = "recordings"
    parts: list[str]
    recordings: list[str]
    folds: int
    seeds: list[int]
    touches: dict[str, int]
    table: list[AccuracyRow]
    leak: list[LeakRow]
    left_out: list[LeftOutRow] = field(default_factory=list)
    sessions: dict[str, int]
    people: dict[str, int]
    warnings: list[str]
    skipped: dict[str, str]


EvaluateResult = (
    KasparResult | CrossPatchResult | PhysicsResult | RecordingsResult | BaxterResult | TimeResult
    | FingersResult | HandsResult | PrintsResult | ForceResult | LoadsResult
)  # fmt: skip
