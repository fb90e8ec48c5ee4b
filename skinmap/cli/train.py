"""`skinmap train`: train a touch classifier on a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from skinmap.commands.options import json_option, open_robot, part_option, robot_option, seed_option
from skinmap.commands.profiles import profile_option
from skinmap.report.present import emit


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
    "--output",
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
@json_option
def command(
    recording: Path,
    robot: str,
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
    import numpy as np

    from skinmap.classify.classifier_options import tuned_classifier
    from skinmap.classify.evaluate import score, split_touches
    from skinmap.classify.model_file import save_classifier
    from skinmap.cli.classify.command import prepare_skins
    from skinmap.cli.structures import auto_radius_of, read_radius
    from skinmap.io.output import staged_file
    from skinmap.io.recordings.touch_files import load_recordings
    from skinmap.neighbours.structures import RADIUS

    knobs = _own_knobs(knobs)
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
        model = untrained.fit(split.train, rng=rng)
        save_classifier(model, stage)
    same, other = score(model, split.same_parts), score(model, split.other_parts)
    result = {
        "classifier": classifier,
        "settings": {name: value for name, value in knobs.items() if value is not None},
        "labels": list(model.labels),
        "touches": len(split.train),
        "seed": seed,
        "accuracy": {"same_parts": same.accuracy, "other_parts": other.accuracy},
        "tested": {"same_parts": same.touches, "other_parts": other.touches},
        "per_part": {**same.per_part, **other.per_part},
        "files": [output],
    }
    if as_json:
        emit(result)
        return
    click.echo(f"{classifier}: trained on {len(split.train)} touches of {', '.join(model.labels)}")
    for name, tested in (("the same parts", same), ("other parts", other)):
        if tested.touches:
            click.echo(f"{100 * tested.accuracy:.1f} % of {tested.touches} touches on {name}")
    click.echo(str(output))


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
