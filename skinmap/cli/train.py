"""`skinmap train`: train a touch classifier on a recording."""

from __future__ import annotations

from pathlib import Path

import click

from skinmap.cli.common import emit, json_option, open_robot, part_option, robot_option, seed_option


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
@seed_option
@json_option
def command(
    recording: Path,
    robot: str,
    parts: tuple[str, ...],
    classifier: str,
    output: Path,
    seed: int,
    as_json: bool,
) -> None:
    """Train on the parts given (all recorded parts by default) and test at once.

    A third of the touches is held out; recorded parts that are not trained on are a second test.

    \b
    Example:  skinmap train touches.npz --part torso --part left_arm -o touch.skinmodel
    """
    import numpy as np

    from skinmap.classify.classifier import classifiers
    from skinmap.classify.evaluate import score, split_touches
    from skinmap.classify.model_file import save_classifier
    from skinmap.cli.classify import prepare_skins
    from skinmap.io.output import staged_file
    from skinmap.io.recordings import load_recordings

    make = classifiers.get(classifier)
    recordings = load_recordings(recording)
    loaded, _ = open_robot(robot, ())
    skins = prepare_skins(loaded, recordings)
    rng = np.random.default_rng(seed)
    split = split_touches(skins, recordings, parts or tuple(skins), rng=rng)
    with staged_file(output) as stage:
        model = make().fit(split.train, rng=rng)
        save_classifier(model, stage)
    same, other = score(model, split.same_parts), score(model, split.other_parts)
    result = {
        "classifier": classifier,
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
