"""`skinmap evaluate`: how well classifiers do, measured as their authors did and without leaks."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import click
from click.core import ParameterSource

from skinmap.cli.evaluate.evaluation import (
    ON_DATA,
    PROTOCOLS,
    Settings,
    find_evaluation,
    own_settings,
)
from skinmap.commands.options import (
    PATH,
    Whole,
    Written,
    file_option,
    out_folder,
    part_option,
    per_gesture_option,
    prints,
    seed_option,
)
from skinmap.commands.spreading import WorkerOptions, workers_options
from skinmap.recognition.protocols.results import EvaluateResult
from skinmap.report.page import lines_page, media
from skinmap.report.present import present
from skinmap.report.result import plain

PREDICTING = ("prints", "load")  # protocols that write what they answered
UNNAMED = ("force", "load", "prints", "fingers", "hands")  # that train no classifier
COUNTED = ("cross-patch", "physics", "time", "force")  # that take --per-gesture
SEEDS = {"baxter": 10, "physics": 1, "time": 1, "force": 1}  # of the others 5
CLEAN = ("kaspar", "baxter")  # protocols of papers: pads of fixed sizes on clean sensors


@click.command("evaluate")
@click.argument("recordings", nargs=-1, metavar="[RECORDING...]", type=PATH)
@click.option(
    "--protocol",
    metavar="|".join(PROTOCOLS) + "|RECORDING",
    help="Protocol to run; recordings are cross-validated by touch event.",
)
@click.option("--robot", metavar="ROBOT", help="Robot to simulate on, or that was recorded.")
@part_option
@click.option(
    "--seeds",
    type=Whole(1, 1000),
    help="Repetitions.  [default: 5; baxter: 10, physics, time, force: 1]",
)
@click.option(
    "--classifier",
    "names",
    metavar="CLASSIFIER",
    multiple=True,
    help="Only this one; may be repeated.",
)
@per_gesture_option(
    "cross-patch, physics, time, force: touches of each gesture on each patch or part."
)
@click.option(
    "--variety",
    metavar="none|some|wide|wider|X",
    help="Random spread of simulated touches and sensors, as in `skinmap simulate`.  "
    "[default: wide; kaspar, baxter: none, as in the papers]",
)
@click.option(
    "--sampling",
    type=click.Choice(["random", "paper"]),
    help="kaspar: draw samples at random, or every 50th and 10th as published.",
)
@click.option(
    "--network",
    type=click.Choice(["small", "paper"]),
    help="baxter: a small network, or that of the paper.",
)
@click.option(
    "--set",
    "own",
    metavar="NAME=VALUE",
    multiple=True,
    help="A setting of the protocol (below); may be repeated.",
)
@click.option(
    "--leave-out",
    multiple=True,
    type=click.Choice(["event", "session", "person", "place", "part"]),
    help="recordings: train without each of them in turn, beside touches dealt out (event) and "
    "controls by what the skin read before the touches; may be repeated.",
)
@file_option(
    "--predictions",
    Written(".npz"),
    "load, prints: archive of arrays to write: each answer, with its interval.",
)
@workers_options(resume=True)
@out_folder("evaluation.json, report.html and the picture of the sweep")
@seed_option
@prints(*get_args(EvaluateResult))
def command(
    recordings: tuple[Path, ...],
    protocol: str | None,
    as_json: bool,
    out: Path | None,
    spread: WorkerOptions,
    **options: Any,
) -> None:
    """Run an evaluation protocol and print its tables.

    IMAGES of --protocol baxter is a folder with a folder of pictures for each label (hand,
    other), a folder of `skinmap export --format images`, or its .npz.

    Results are the same whatever the jobs. With --resume FOLDER a run that was
    interrupted goes on where it ended.

    \b
    Settings (--set NAME=VALUE):
      kaspar       places=anywhere|habitual  where people touch
                   places=grips              grips at habitual places, pokes anywhere
                   sampling=random|paper     every 50th and 10th sample, as published
                   sweep=no|yes              sweep r and k (always with --out)
      baxter       images=1800               images, 90 or more
                   network=small|paper       paper takes 2 to 6 minutes a training,
                                             and tries 7 rates in 5 folds a split
      cross-patch  train_robot=ROBOT         train on this robot, test on --robot
      cross-patch, physics, time, recordings
                   gestures=four|eight|all|time|NAME,NAME...  touches to tell apart
      recordings   folds=4                   folds, 2 to 20
      prints       pitch_mm=4.79             between readings
      load         zero=auto|none|first      rest before and after load, or before it

    \b
    Example:  skinmap evaluate --protocol kaspar --seeds 3 --json
              skinmap evaluate --protocol cross-patch --robot icub --seeds 1
              skinmap evaluate --protocol physics --seeds 1 --per-gesture 5
              skinmap evaluate --protocol baxter --network paper --json
              skinmap evaluate --protocol baxter IMAGES
              skinmap evaluate --protocol time --per-gesture 8
              skinmap evaluate --protocol fingers DATA
              skinmap evaluate --protocol force --per-gesture 4
              skinmap evaluate --protocol prints TRAIN.npz TEST.npz --predictions areas.npz
              skinmap evaluate --protocol load MODEL RECORDING.npz --json
              skinmap evaluate touches.npz --robot icub
              skinmap evaluate monday.mcap tuesday.mcap --leave-out session
              skinmap evaluate --protocol kaspar --set sweep=yes --jobs 4 --resume kaspar.resume
    """
    chosen, files = _protocol(protocol, recordings)
    if options["predictions"] and chosen not in PREDICTING:
        raise click.UsageError(f"--predictions: {chosen} writes none; of {', '.join(PREDICTING)}")
    if options["names"] and chosen in UNNAMED:
        raise click.UsageError(f"--protocol {chosen} trains no classifier: no --classifier")
    given = click.get_current_context().get_parameter_source("per_gesture")
    if given is ParameterSource.COMMANDLINE and chosen not in COUNTED:
        raise click.UsageError(f"--per-gesture is of {', '.join(COUNTED)}; not of {chosen}")
    for name, only in {"sampling": "kaspar", "network": "baxter"}.items():
        if options[name] and chosen != only:
            raise click.UsageError(f"--{name} is of {only}; not of {chosen}")
    options["seeds"] = options["seeds"] or SEEDS.get(chosen, 5)
    options["variety"] = _variety(chosen, options["variety"])
    evaluation = find_evaluation(chosen)
    words = [f"{name}={options[name]}" for name in ("sampling", "network") if options[name]]
    del options["sampling"], options["network"]
    own = own_settings(evaluation.settings, chosen, (*words, *options.pop("own")))
    with spread.open(f"evaluate {chosen}") as workers:
        settings = Settings(
            recordings=files, workers=workers, own=own, pictures=out is not None, **options
        )
        result = evaluation.work(settings)
    title = f"{result.robot}: evaluation, {result.protocol}"
    present(
        result,
        evaluation.lines,
        as_json=as_json,
        out=out,
        write=lambda stage: _write(result, evaluation.draw, stage),
        page=lambda stage: lines_page(
            title,
            evaluation.lines(result),
            [media(path, path.stem) for path in sorted(stage.glob("*.png"))],
        ),
    )


def _write(result: EvaluateResult, draw: Any, stage: Path) -> Iterator[str]:
    """Write the result as JSON, and the picture that its protocol may draw; names of the files."""
    numbers = {key: value for key, value in plain(result).items() if key != "files"}
    text = json.dumps(numbers, indent=2, allow_nan=False) + "\n"
    (stage / "evaluation.json").write_text(text, encoding="utf-8")
    yield "evaluation.json"
    if draw is not None:
        draw(result, stage / "sweep.png")
        yield "sweep.png"


def _variety(protocol: str, asked: str | None) -> float:
    """How far touches are drawn at random, by default as the protocol has it."""
    from skinmap.touch.simulation.variety import variety_of

    if asked and (protocol == "recordings" or protocol in ON_DATA):
        raise click.UsageError(f"{protocol}: recorded touches have no --variety")
    return variety_of(asked or ("none" if protocol in CLEAN else "wide"))


def _protocol(protocol: str | None, recordings: tuple[Path, ...]) -> tuple[str, tuple[Path, ...]]:
    """The protocol and its recordings; a file may stand in either place."""
    from skinmap.errors import unknown_name

    if protocol in PROTOCOLS:
        ctx = click.get_current_context()
        if ctx.params["leave_out"]:
            raise click.UsageError(f"--protocol {protocol} has its own splits: no --leave-out")
        if protocol in ON_DATA:
            least, most, named = ON_DATA[protocol]
            if not least <= len(recordings) <= most:
                raise click.UsageError(
                    f"--protocol {protocol} needs {named}; "
                    f"got {len(recordings)} of them: docs/evaluation.md"
                )
            return protocol, recordings
        if protocol == "baxter" and len(recordings) == 1:
            return protocol, recordings
        if recordings:
            raise click.UsageError(f"--protocol {protocol} simulates its touches: no recordings")
        return protocol, ()
    files = ((Path(protocol),) if protocol else ()) + recordings
    if not files:
        raise click.UsageError(f"name --protocol ({', '.join(PROTOCOLS)}) or recordings")
    if protocol and not Path(protocol).exists() and not Path(protocol).suffix:
        raise click.UsageError(unknown_name("protocol or recording", protocol, PROTOCOLS))
    return "recordings", files
