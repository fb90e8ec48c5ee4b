"""`skinmap evaluate`: how well classifiers do, measured as their authors did and without leaks."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import click

from skinmap.cli.evaluate.evaluation import (
    ON_DATA,
    PROTOCOLS,
    Evaluation,
    Settings,
    find_evaluation,
)
from skinmap.cli.evaluate.result import EvaluateResult
from skinmap.commands.options import (
    MAX_TOUCHES,
    out_folder,
    outside_option,
    part_option,
    per_gesture_option,
    places_option,
    prints,
    seed_option,
)
from skinmap.commands.profiles import from_profile, profile_option
from skinmap.commands.workers import worker_options, workers_options
from skinmap.report.image import media
from skinmap.report.page import lines_page
from skinmap.report.present import present
from skinmap.report.result import plain

OWN_CLASSIFIERS = ("kaspar", "baxter")  # protocols that compare methods of their own


@click.command("evaluate")
@click.argument("recordings", nargs=-1, metavar="[RECORDING...]", type=click.Path(path_type=Path))
@click.option(
    "--protocol",
    metavar="|".join(PROTOCOLS) + "|RECORDING",
    help="What to measure; recordings are cross-validated by touch event.",
)
@click.option("--robot", metavar="ROBOT", help="Robot to simulate on, or that was recorded.")
@click.option(
    "--train-robot", metavar="ROBOT", help="cross-patch: train on this robot, test on --robot."
)
@outside_option
@part_option
@click.option(
    "--seeds",
    type=click.IntRange(1, 1000),
    help="Repetitions.  [default: 5; baxter: 10, physics, time: 1]",
)
@click.option(
    "--classifier",
    "names",
    metavar="CLASSIFIER",
    multiple=True,
    help="Only this one; may be repeated.",
)
@click.option(
    "--gestures",
    default="four",
    show_default=True,
    metavar="four|eight|all|time|NAME,NAME...",
    help="Touches to tell apart (recordings: all by default; time: time).",
)
@per_gesture_option("cross-patch, physics, time: touches of each gesture on each patch or part.")
@places_option("kaspar")
@click.option("--sweep", is_flag=True, help="kaspar: sweep r and k (always with --out).")
@click.option(
    "--images",
    type=click.IntRange(40, MAX_TOUCHES),
    default=1800,
    show_default=True,
    help="baxter: images.",
)
@click.option(
    "--network",
    type=click.Choice(["small", "paper"]),
    default="small",
    show_default=True,
    help="baxter: the network; the paper's takes 10 minutes a training.",
)
@click.option(
    "--folds", type=click.IntRange(2, 20), default=4, show_default=True, help="recordings: folds."
)
@click.option(
    "--leave-out",
    multiple=True,
    type=click.Choice(["session", "person", "place", "part"]),
    help="recordings: train without each of them in turn; may be repeated.",
)
@click.option(
    "--leaks",
    is_flag=True,
    help="recordings: a control beside each figure, by what the skin read before the touches.",
)
@workers_options
@out_folder("pictures, evaluation.json and report.html")
@seed_option
@profile_option("classify")
@prints(*get_args(EvaluateResult))
def command(
    recordings: tuple[Path, ...],
    protocol: str | None,
    as_json: bool,
    out: Path | None,
    **options: Any,
) -> None:
    """Run an evaluation protocol and print its tables.

    Results are the same whatever the number of jobs and whatever the backend. With --resume FILE
    a run that was interrupted goes on where it ended.

    \b
    Example:  skinmap evaluate --protocol kaspar --seeds 3 --json
              skinmap evaluate --protocol cross-patch --robot icub --seeds 1
              skinmap evaluate --protocol physics --seeds 1 --per-gesture 5
              skinmap evaluate --protocol time --per-gesture 8
              skinmap evaluate --protocol fingers DATA
              skinmap evaluate touches.npz --robot icub
              skinmap evaluate monday.mcap tuesday.mcap --leave-out session --leaks
              skinmap evaluate --protocol kaspar --sweep --jobs 4 --resume kaspar.resume
    """
    chosen, files = _protocol(protocol, recordings)
    spread = worker_options(options)
    options["seeds"] = options["seeds"] or {"baxter": 10, "physics": 1, "time": 1}.get(chosen, 5)
    if chosen in OWN_CLASSIFIERS and from_profile("names"):
        options["names"] = ()  # a profile's classifier is one of those that are compared anyway
    options["sweep"] = options["sweep"] or out is not None
    with spread.open(f"evaluate {chosen}") as workers:
        evaluation = find_evaluation(chosen)
        settings = Settings(protocol=chosen, recordings=files, workers=workers, **options)
        result = evaluation.work(settings)
    title = f"{result.robot}: evaluation, {result.protocol}"
    present(
        result,
        evaluation.lines,
        as_json=as_json,
        out=out,
        write=lambda stage: _write(result, evaluation, stage),
        page=lambda stage: lines_page(
            title,
            evaluation.lines(result),
            [media(path, path.stem) for path in sorted(stage.glob("*.png"))],
        ),
    )


def _write(result: EvaluateResult, evaluation: Evaluation, stage: Path) -> Iterator[str]:
    """Write the result as JSON and its pictures; names of the files."""
    numbers = {key: value for key, value in plain(result).items() if key != "files"}
    text = json.dumps(numbers, indent=2, allow_nan=False) + "\n"
    (stage / "evaluation.json").write_text(text, encoding="utf-8")
    yield "evaluation.json"
    for name, draw in evaluation.FIGURES.items():
        draw(result, stage / name)
        yield name


def _pictures(stage: Path) -> list[str]:
    return [media(path, path.stem) for path in sorted(stage.glob("*.png"))]


def _protocol(protocol: str | None, recordings: tuple[Path, ...]) -> tuple[str, tuple[Path, ...]]:
    """The protocol and its recordings; a file may stand in either place."""
    from skinmap.errors import unknown_name

    if protocol in PROTOCOLS:
        ctx = click.get_current_context()
        if ctx.params["leave_out"] or ctx.params["leaks"]:
            raise click.UsageError(
                f"--protocol {protocol} has its own splits: no --leave-out, --leaks"
            )
        if protocol in ON_DATA:
            if len(recordings) != 1:
                raise click.UsageError(
                    f"--protocol {protocol} needs its file or folder; "
                    f"got {len(recordings)} of them: docs/evaluation.md"
                )
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
