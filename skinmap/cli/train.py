"""`skinmap train`: train a touch classifier on recordings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from skinmap.commands import options
from skinmap.commands.progress import progress
from skinmap.errors import InvalidArrayError, UnknownNameError, check_known
from skinmap.io.output import staged_file
from skinmap.report.present import present
from skinmap.summary import first_few

if TYPE_CHECKING:
    from numpy.random import Generator

    from skinmap.cli.collection import Collection
    from skinmap.recognition.descriptors import Touch
    from skinmap.recognition.evaluate import Split

    Touches = list[Touch]

# Settings of classifiers that only a profile has.
IN_PROFILE = ("radius_mm", "words", "rotations", "distance", "image_size")
SHOWN = 12  # sessions or people that a line names
UNEVEN = 0.03  # between the accuracies of touches and of labels, from which both are shown


@dataclass(frozen=True, kw_only=True, slots=True)
class Accuracy:
    """Share of touches named as recorded.

    Attributes
    ----------
    same_parts
        Of touches held out on the parts trained on; null where there is none.
    other_parts
        Of touches on parts that were not trained on; null where there is none.
    """

    same_parts: float | None
    other_parts: float | None


@dataclass(frozen=True, kw_only=True, slots=True)
class Tested:
    """Number of touches behind each accuracy.

    Attributes
    ----------
    same_parts
        Number of touches on parts of the training.
    other_parts
        Number of touches on other parts.
    """

    same_parts: int
    other_parts: int


@dataclass(frozen=True, kw_only=True, slots=True)
class TrainedPart:
    """A skin that was trained on.

    Attributes
    ----------
    robot
        Name of the robot.
    part
        Name of the part.
    taxels
        Total number of taxels.
    touches
        Number of recorded touches.
    """

    robot: str
    part: str
    taxels: int
    touches: int


@dataclass(frozen=True, kw_only=True, slots=True)
class TrainResult:
    """A model and how well it does.

    Attributes
    ----------
    classifier
        Name of the classifier.
    settings
        Knobs that were given.
    labels
        Labels of the model.
    touches
        Number of training touches.
    simulated
        Of them, by label, simulated ones; nothing is tested on these.
    seed
        Seed of all randomness.
    tested_by
        Touches that were held out, or all of them in turn where there are few: then the model is
        trained on all.
    accuracy
        On touches that it has not seen.
    tested
        Numbers of tested touches.
    per_part
        Accuracy by the name of the part.
    per_label
        Accuracy by the label, on the parts trained on.
    skins
        Skins of the recordings.
    people, sessions
        Recorded touches of each; people who are not named are left out.
    groups
        Labels that count as a hand, and as something else; empty where the model that ships decides
        that.
    kinds
        Labels that are kinds of touch.
    motions
        Labels that are motions.
    warnings
        Weaknesses of the recordings behind the figures.
    files
        Name of the model.
    """

    classifier: str
    settings: dict[str, Any]
    labels: list[str]
    touches: int
    simulated: dict[str, int]
    seed: int
    tested_by: Literal["held_out", "cross_validation"]
    accuracy: Accuracy
    tested: Tested
    per_part: dict[str, float]
    per_label: dict[str, float]
    skins: list[TrainedPart]
    people: dict[str, int]
    sessions: dict[str, int]
    groups: dict[str, list[str]]
    kinds: list[str]
    motions: list[str]
    warnings: list[str]
    files: list[str]


@click.command("train")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...", type=options.PATH)
@options.robot_option
@options.part_option
@options.word(
    "--classifier",
    "CLASSIFIER",
    "Classifier by name; an unknown name lists them.",
    shown="contact-geometry",
)
@options.choice(
    "--network",
    ("small", "paper"),
    "cnn: a small network (default), or that of the paper, 50 kernels a layer on 66 x 100.",
)
@options.out_file("Model to write.", default="touch.skinmodel")
@options.whole(
    "--with-simulated",
    1,
    1000,
    "Add N simulated touches of each recorded label that the simulator has, on each skin.",
    metavar="N",
)
@options.word(
    "--groups",
    "hand=LABEL,...;other=LABEL,...",
    "Learn from these labels whether a touch is a hand: each label in one group.",
)
@options.word(
    "--motion",
    "LABEL,...",
    "Labels that name how a touch moves, beside stroke, pat, tap, rub, slide, twist, squeeze "
    "and hold; all others name with what.",
)
@options.seed_option
@options.profile_option("classify", beside=IN_PROFILE)
@options.prints(TrainResult)
def command(as_json: bool, **asked: Any) -> None:
    """Train on RECORDINGS, files and folders of them, of one robot or several.

    The parts given are trained on, all that were recorded by default. A third of the touches is
    held out; recorded parts that are not trained on are a second test. Where a label has few
    touches, five for one, the model learns from all and each is tested by a model without it.

    A profile sets radius_mm, words, rotations, distance and image_size, too. The
    model keeps all settings; those that do not concern the classifier are refused.

    \b
    Example:  skinmap train touches.npz --part torso --part left_arm -o touch.skinmodel
              skinmap train poke.mcap rub.mcap monday/ --with-simulated 20
              skinmap train t.npz --groups "hand=poke,whole_hand;other=elbow,ball"
    """
    present(work(**asked), _lines, as_json=as_json)


def work(
    recordings: Sequence[Path],
    robot: str | None,
    parts: tuple[str, ...],
    classifier: str,
    output: Path,
    with_simulated: int | None,
    groups: str | None,
    motion: str | None,
    seed: int,
    **knobs: Any,
) -> TrainResult:
    """Train, write the model, and test it on what it has not seen."""
    import numpy as np

    from skinmap.cli.collection import collect
    from skinmap.neighbours.offsets import auto_radius
    from skinmap.neighbours.structures import RADIUS, usual_radius
    from skinmap.recognition.answering import (
        check_groups,
        check_motions,
        learn_answers,
        read_groups,
    )
    from skinmap.recognition.classifier import WITH_SETS
    from skinmap.recognition.evaluate import is_few, score, score_in_turn
    from skinmap.recognition.model_file import SUFFIX, save_classifier
    from skinmap.recognition.training import tuned_classifier

    if output.suffix.lower() not in ("", SUFFIX):  # by which `classify` knows a model
        raise UnknownNameError("format of models for files ending in", output.suffix, [SUFFIX])
    grouped = None if groups is None else read_groups(groups)
    said = () if motion is None else tuple(one.strip() for one in motion.split(","))
    knobs = _own_knobs(classifier, knobs)
    untrained = partial(tuned_classifier, classifier, knobs)
    auto = knobs.get("radius_mm") == "auto"
    if knobs.get("radius_mm") is not None:
        knobs["radius_mm"] = round(
            1e3 * (options.read_radius(str(knobs["radius_mm"])) or RADIUS), 9
        )
    untrained()  # refuses knobs before anything is read
    found = collect(recordings, robot)
    if auto:
        places = [one.skin.positions for one in found.skins.values()]
        knobs["radius_mm"] = 1e3 * auto_radius(places, near=usual_radius(places))
    # Drawn apart from recordings of the same seed, whose trials may have been shuffled by it.
    rng = np.random.default_rng([seed, 11])
    split = _split(found, parts, rng)
    train, same, other = [*split.train], [*split.same_parts], split.other_parts
    warnings = list(found.doubts())
    if other and getattr(untrained().descriptor, "one_skin", False):  # taxels by their number
        passed = ", ".join(sorted({touch.skin.skin.part for touch in other}))
        warnings.append(f"{classifier} reads taxels by number; not tested on other parts: {passed}")
        other = ()
    few = is_few(train, same)
    if few:
        train, same = train + same, []
    names = sorted({touch.label for touch in train})
    if grouped is not None:
        check_groups(grouped, names)
    motions = check_motions(said, names)
    extra = _simulated(train, with_simulated or 0, rng)
    with staged_file(output) as stage:
        model = untrained()
        model.fit(train + extra, rng=rng, sets=classifier in WITH_SETS)
        learn_answers(model, train + extra, groups=grouped, motions=motions, rng=rng)
        save_classifier(model, stage)
        seen = score_in_turn(untrained, train, extra, rng=rng) if few else score(model, same)
        unseen = score(model, other)
    people = {name: count for name, count in found.count("person").items() if name}
    return TrainResult(
        classifier=classifier,
        settings={name: value for name, value in knobs.items() if value is not None},
        labels=list(model.labels),
        touches=len(train) + len(extra),
        simulated=dict(sorted(Counter(touch.label for touch in extra).items())),
        seed=seed,
        tested_by="cross_validation" if few else "held_out",
        accuracy=Accuracy(same_parts=seen.accuracy, other_parts=unseen.accuracy),
        tested=Tested(same_parts=seen.touches, other_parts=unseen.touches),
        per_part={**seen.per_part, **unseen.per_part},
        per_label=dict(seen.per_label),
        skins=_skins(found),
        people=people,
        sessions=found.count("session"),
        groups={name: list(own) for name, own in (grouped or {}).items()},
        kinds=[name for name in names if name not in motions],
        motions=list(motions),
        warnings=warnings,
        files=[str(output)],
    )


def _split(found: Collection, parts: Sequence[str], rng: Generator) -> Split:
    """Touches to train on, others of the same parts, and those of other parts; of each skin apart.

    Raises
    ------
    UnknownNameError
        A part to train on that no recording is of.
    InvalidArrayError
        Fewer than two labels.
    """
    from skinmap.recognition.evaluate import split_parts
    from skinmap.recognition.protocols.recordings import check_spelling

    check_known("recorded part", parts, found.parts)
    labels = Counter(one.touch.label for one in found.touches)
    if len(labels) < 2:
        have = ", ".join(f"{count} {label}" for label, count in labels.items())
        raise InvalidArrayError(
            f"training needs two labels or more; marked are: {have or 'none'}; record another kind "
            f"of touch, or name these with `skinmap label`"
        )
    check_spelling(sorted(labels))
    every = [
        (part, [one.touch for one in found.touches if one.touch.skin is skin])
        for (_, part), skin in found.skins.items()
    ]
    return split_parts(every, parts or found.parts, rng=rng, by_label=True)


def _simulated(train: Touches, count: int, rng: Generator) -> Touches:
    """Simulated touches of the labels that were recorded, on the skins that are trained on.

    Raises
    ------
    UsageError
        No label that the simulator knows.
    """
    from skinmap.recognition.descriptors import recorded_touches
    from skinmap.touch.simulation.gestures import GESTURES, TIME
    from skinmap.touch.simulation.simulator import simulate

    if not count:
        return []
    labels = sorted({touch.label for touch in train})
    known = [label for label in labels if label in (*GESTURES, *TIME)]
    if not known:
        raise click.UsageError(
            f"--with-simulated: none of {', '.join(labels)} is simulated; the gestures are: "
            f"{', '.join((*GESTURES, *TIME))}"
        )
    skins = dict.fromkeys(touch.skin for touch in train)
    with progress(len(skins), "simulating") as advance:
        made: Touches = []
        for skin in skins:
            recording = simulate(skin.skin, rng=rng, per_gesture=count, gestures=known)
            made += recorded_touches(skin, recording)
            advance(skin.skin.part)
    return made


def _skins(found: Collection) -> list[TrainedPart]:
    counts = found.count("robot", "part")
    return [
        TrainedPart(robot=robot, part=part, taxels=len(skin), touches=counts.get((robot, part), 0))
        for (robot, part), skin in found.skins.items()
    ]


def _lines(result: TrainResult) -> Iterator[str]:
    labels = ", ".join(result.labels)
    yield f"{result.classifier}: trained on {result.touches} touches of {labels}"
    if result.simulated:
        yield f"{sum(result.simulated.values())} of them simulated: {_counted(result.simulated)}"
    for one in result.skins:
        yield f"{one.robot} {one.part}, {one.taxels} taxels: {one.touches} touches"
    if result.kinds and result.motions:
        yield f"kinds: {', '.join(result.kinds)}; motions: {', '.join(result.motions)}"
    from skinmap.cli.collection import SIMULATED

    drawn = sum(SIMULATED in name for name in result.people)
    if drawn:
        yield f"people: {drawn} simulated"
    for what, counts in (("sessions", result.sessions), ("people", result.people)):
        if counts and not drawn:
            yield f"{what}: {_counted(counts)}"
    both = (
        ("the same parts", result.accuracy.same_parts, result.tested.same_parts),
        ("other parts", result.accuracy.other_parts, result.tested.other_parts),
    )
    for where, accuracy, tested in both:
        if tested and accuracy is not None:
            in_turn = result.tested_by == "cross_validation" and where == "the same parts"
            how = ", each named by a model trained on the others" if in_turn else ""
            yield f"{100 * accuracy:.1f} % of {tested} touches on {where}{how}"
    shares = result.per_label.values()
    mean = sum(shares) / len(shares) if shares else 0.0
    if result.accuracy.same_parts is not None and abs(mean - result.accuracy.same_parts) > UNEVEN:
        each = first_few([f"{name} {100 * own:.0f} %" for name, own in result.per_label.items()])
        yield f"labels differ: {100 * mean:.1f} % in the mean of labels ({each})"
    for doubt in result.warnings:
        yield f"warning: {doubt}"


def _counted(counts: Mapping[str, int]) -> str:
    return first_few([f"{name} ({count})" for name, count in counts.items()], SHOWN)


def _own_knobs(classifier: str, knobs: dict[str, Any]) -> dict[str, Any]:
    """The knobs that were given; a profile's only for the classifier that it names, if it does."""
    if (click.get_current_context().default_map or {}).get("classifier", classifier) == classifier:
        return knobs
    return {}
