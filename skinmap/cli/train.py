"""`skinmap train`: train a touch classifier on a recording."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from skinmap.commands.options import open_robot, part_option, prints, robot_option, seed_option
from skinmap.commands.profiles import profile_option
from skinmap.report.present import present


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
    """How many touches the accuracy is of.

    Attributes
    ----------
    same_parts, other_parts
        As above.
    """

    same_parts: int
    other_parts: int


@dataclass(frozen=True, kw_only=True, slots=True)
class TrainResult:
    """A model and how well it does.

    Attributes
    ----------
    classifier
        Its name.
    settings
        Knobs that were given.
    labels
        That it knows.
    touches
        That it was trained on.
    seed
        Of all randomness.
    accuracy
        On touches that it has not seen.
    tested
        How many those were.
    per_part
        Accuracy by part.
    files
        The model.
    """

    classifier: str
    settings: dict[str, Any]
    labels: list[str]
    touches: int
    seed: int
    accuracy: Accuracy
    tested: Tested
    per_part: dict[str, float]
    files: list[str]


@click.command("train")
@click.argument("recording", type=click.Path(path_type=Path))
@robot_option
@part_option
@click.option(
    "--classifier",
    default="contact-geometry",
    show_default=True,
    help="Which classifier; an unknown name lists them.",
)
@click.option(
    "-o",
    "--out",
    "output",
    type=click.Path(path_type=Path),
    default=Path("touch.skinmodel"),
    show_default=True,
    help="Model to write.",
)
@click.option(
    "--radius-mm",
    help="Histograms: of a neighbourhood, or auto, as structures has it.  [default: 8]",
)
@click.option("--words", type=int, help="Codewords of a structure, or of images.")
@click.option("--rotations", type=int, help="Histograms: turns of a structure, 1, 4 or 6.")
@click.option("--distance", help="Histograms: euclidean, or geodesic (along the skin).")
@click.option("--search", help="Histograms: how codewords are looked for, plain or compiled.")
@click.option("--precision", help="Histograms: of distances from codewords, float64 or float32.")
@click.option("--image-size", metavar="ROWSxCOLUMNS", help="Contact images.  [default: 66x100]")
@seed_option
@profile_option("classify")
@prints(TrainResult)
def command(
    recording: Path,
    robot: str | None,
    parts: tuple[str, ...],
    classifier: str,
    output: Path,
    seed: int,
    as_json: bool,
    **knobs: Any,
) -> None:
    """Train on the parts given (all recorded parts by default) and test at once.

    A third of the touches is held out; recorded parts that are not trained on are a second test.

    The model keeps its settings: `classify` needs to be told none of them. Settings that do not
    concern the classifier are refused.

    \b
    Example:  skinmap train touches.npz --part torso --part left_arm -o touch.skinmodel
    """
    result = work(recording, robot, parts, classifier, output, seed, _own_knobs(knobs))
    present(result, _lines, as_json=as_json)


def work(
    recording: Path,
    robot: str | None,
    parts: tuple[str, ...],
    classifier: str,
    output: Path,
    seed: int,
    knobs: dict[str, Any],
) -> TrainResult:
    """Train, write the model, and test it on what it has not seen."""
    import numpy as np

    from skinmap.classify.classifier import WITH_SETS
    from skinmap.classify.classifier_options import tuned_classifier
    from skinmap.classify.evaluate import score, split_touches
    from skinmap.classify.model_file import save_classifier
    from skinmap.cli.structures import auto_radius_of, read_radius
    from skinmap.io.output import staged_file
    from skinmap.io.recordings.touch_files import load_recordings
    from skinmap.neighbours.structures import RADIUS
    from skinmap.touch.prepared_skin import prepare_skins

    auto = knobs.get("radius_mm") == "auto"
    if knobs.get("radius_mm") is not None:
        knobs["radius_mm"] = round(1e3 * (read_radius(knobs["radius_mm"]) or RADIUS), 9)
    untrained = tuned_classifier(classifier, knobs)
    recordings = load_recordings(recording)
    loaded, _ = open_robot(robot, ())
    skins = prepare_skins(loaded, recordings)
    if auto:
        knobs["radius_mm"] = 1e3 * auto_radius_of(skins)
        untrained = tuned_classifier(classifier, knobs)
    rng = np.random.default_rng(seed)
    split = split_touches(skins, recordings, parts or tuple(skins), rng=rng)
    with staged_file(output) as stage:
        model = untrained.fit(split.train, rng=rng, sets=classifier in WITH_SETS)
        save_classifier(model, stage)
    same, other = score(model, split.same_parts), score(model, split.other_parts)
    return TrainResult(
        classifier=classifier,
        settings={name: value for name, value in knobs.items() if value is not None},
        labels=list(model.labels),
        touches=len(split.train),
        seed=seed,
        accuracy=Accuracy(same_parts=same.accuracy, other_parts=other.accuracy),
        tested=Tested(same_parts=same.touches, other_parts=other.touches),
        per_part={**same.per_part, **other.per_part},
        files=[str(output)],
    )


def _lines(result: TrainResult) -> Iterator[str]:
    labels = ", ".join(result.labels)
    yield f"{result.classifier}: trained on {result.touches} touches of {labels}"
    both = (
        ("the same parts", result.accuracy.same_parts, result.tested.same_parts),
        ("other parts", result.accuracy.other_parts, result.tested.other_parts),
    )
    for where, accuracy, tested in both:
        if tested and accuracy is not None:
            yield f"{100 * accuracy:.1f} % of {tested} touches on {where}"


def _own_knobs(knobs: dict[str, Any]) -> dict[str, Any]:
    """The knobs that were given; a profile's only together with its classifier."""
    ctx = click.get_current_context()
    if ctx.get_parameter_source("classifier") is ParameterSource.DEFAULT_MAP:
        return knobs
    return {
        name: value
        for name, value in knobs.items()
        if ctx.get_parameter_source(name) is not ParameterSource.DEFAULT_MAP
    }
