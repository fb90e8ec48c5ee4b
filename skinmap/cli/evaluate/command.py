"""`skinmap evaluate`: how well classifiers do, measured as their authors did and without leaks.

Each protocol is a module that is found by its name; the settings that they share are here.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import click
import numpy as np
from click.core import ParameterSource
from msgspec import Meta, Struct, ValidationError, convert

from skinmap.commands import options
from skinmap.commands.progress import progress
from skinmap.errors import unknown_name
from skinmap.io.output import staged_file
from skinmap.recognition.protocols.results import EvaluateResult
from skinmap.report.page import lines_page, media
from skinmap.report.present import present
from skinmap.report.result import plain
from skinmap.report.table import Cell, Table

if TYPE_CHECKING:
    from skinmap.parallel.workers import Workers
    from skinmap.recognition.protocols.recordings import Way

PROTOCOLS = {  # and the modules that they share
    "kaspar": "papers", "baxter": "papers", "cross-patch": "simulated", "physics": "simulated",
    "time": "simulated", "fingers": "real", "hands": "real", "prints": "real", "force": "force",
    "load": "force",
}  # fmt: skip
ON_DATA = {  # protocols of files that users bring: how many, and their names
    "fingers": (1, 1, "its file or folder"),
    "hands": (1, 1, "its file or folder"),
    "prints": (2, 2, "TRAIN.npz TEST.npz"),
    "load": (2, 1000, "MODEL RECORDING..."),
}
Rows = list[list[Cell]]


@dataclass(frozen=True, slots=True)
class Settings:
    """The options of the command, checked by click.

    `own` are the protocol's settings, of its type `SETTINGS`; with `pictures` all that they show is
    measured; `predictions` is the file for what a protocol of measured data answered.
    """

    recordings: tuple[Path, ...]
    workers: Workers
    robot: str | None
    parts: tuple[str, ...]
    seeds: int
    seed: int
    names: tuple[str, ...]
    per_gesture: int
    variety: float
    leave_out: tuple[Way, ...]
    pictures: bool
    predictions: Path | None
    own: Any

    @property
    def all_seeds(self) -> list[int]:
        """The seed of each repetition."""
        return list(range(self.seed, self.seed + self.seeds))

    @property
    def drawn(self) -> dict[str, Any]:
        """How touches are drawn, for protocols and for their results."""
        return {"variety": self.variety, "seeds": self.all_seeds}

    @contextmanager
    def working(self, steps: int, title: str) -> Iterator[dict[str, Any]]:
        """Who computes and whom that tells, under a bar of so many steps."""
        with progress(steps, title) as advance:
            yield {"workers": self.workers, "progress": advance}


class Own(Struct, forbid_unknown_fields=True):
    """Settings of a protocol that no other has; this one has none."""


class Gestures(Own):
    """Of protocols that may tell other touches apart than the four."""

    gestures: str = "four"


class Folds(Gestures):
    """Of protocols that deal out what was recorded."""

    folds: Annotated[int, Meta(ge=2, le=20)] = 4


@dataclass(frozen=True, slots=True)
class Evaluation:
    """How a protocol is run and told.

    Attributes
    ----------
    work
        Takes the settings and gives a result.
    lines
        Makes tables of that.
    settings
        What `--set` sets.
    draw
        Draws a picture of the result into a file, where there is one.
    """

    work: Callable[[Settings], Any]
    lines: Callable[[Any], Iterator[str | Table]]
    settings: type[Own] = Own
    draw: Callable[[Any, Path], None] | None = None


def find_evaluation(name: str) -> Evaluation:
    """That of a protocol, or of `recordings`."""
    module = f"skinmap.cli.evaluate.protocol_{PROTOCOLS.get(name, name)}"
    found: Evaluation = importlib.import_module(module).EVALUATIONS[name]
    return found


def own_settings(kind: type[Own], protocol: str, given: Sequence[str]) -> Own:
    """The settings `NAME=VALUE` of a protocol.

    Raises
    ------
    click.UsageError
        No such setting of the protocol, or a value that it does not take.
    """
    found = {}
    for one in given:
        name, equals, value = one.partition("=")
        if name not in kind.__struct_fields__ or not equals:
            known = ", ".join(kind.__struct_fields__) or "none"
            raise click.UsageError(f"--set {one}: settings of {protocol}: {known}")
        found[name] = {"yes": True, "no": False}.get(value, value)
    try:
        return convert(found, kind, strict=False)
    except ValidationError as error:
        raise click.UsageError(f"--set of {protocol}: {error}") from None


def chosen_gestures(settings: Settings) -> tuple[str, ...]:
    """Names of the gestures that were asked for."""
    from skinmap.touch.simulation.hands import gesture_set

    return gesture_set([settings.own.gestures])


def write_predictions(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write what a protocol answered as an archive of arrays."""
    with staged_file(path) as stage, stage.open("wb") as file:
        np.savez_compressed(file, **arrays)


PREDICTING = ("prints", "load")  # protocols that write what they answered
UNNAMED = ("force", "load", "prints", "fingers", "hands")  # that train no classifier
COUNTED = ("cross-patch", "physics", "time", "force")  # that take --per-gesture
SEEDS = {"baxter": 10, "physics": 1, "time": 1, "force": 1}  # of the others 5
CLEAN = ("kaspar", "baxter")  # protocols of papers: pads of fixed sizes on clean sensors


@click.command("evaluate")
@click.argument("recordings", nargs=-1, metavar="[RECORDING...]", type=options.PATH)
@options.word(
    "--protocol",
    "|".join(PROTOCOLS) + "|RECORDING",
    "Protocol to run; recordings are cross-validated by touch event.",
)
@options.word("--robot", "ROBOT", "Robot to simulate on, or that was recorded.")
@options.part_option
@options.whole(
    "--seeds", 1, 1000, "Repetitions.  [default: 5; baxter: 10, physics, time, force: 1]"
)
@options.words("--classifier", "names", "CLASSIFIER", "Only this one; may be repeated.")
@options.per_gesture_option(
    "cross-patch, physics, time, force: touches of each gesture on each patch or part."
)
@options.word(
    "--variety",
    "none|some|wide|wider|X",
    "Random spread of simulated touches and sensors, as in `skinmap simulate`.  "
    "[default: wide; kaspar, baxter: none, as in the papers; physics: wider]",
)
@options.choice(
    "--sampling",
    ("random", "paper"),
    "kaspar: draw samples at random, or every 50th and 10th as published.",
)
@options.choice("--network", ("small", "paper"), "baxter: a small network, or that of the paper.")
@options.words("--set", "own", "NAME=VALUE", "A setting of the protocol (below); may be repeated.")
@options.choice(
    "--leave-out",
    ("event", "session", "person", "place", "part"),
    "recordings: train without each of them in turn, beside touches dealt out (event) and "
    "controls by what the skin read before the touches; may be repeated.",
    multiple=True,
)
@options.file_option(
    "--predictions",
    options.Written(".npz"),
    "load, prints: archive of arrays to write: each answer, with its interval.",
)
@options.workers_options(resume=True)
@options.out_folder("evaluation.json, report.html and the picture of the sweep")
@options.seed_option
@options.prints(*get_args(EvaluateResult))
def command(
    recordings: tuple[Path, ...],
    protocol: str | None,
    as_json: bool,
    out: Path | None,
    spread: options.WorkerOptions,
    **asked: Any,
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
    if asked["predictions"] and chosen not in PREDICTING:
        raise click.UsageError(f"--predictions: {chosen} writes none; of {', '.join(PREDICTING)}")
    if asked["names"] and chosen in UNNAMED:
        raise click.UsageError(f"--protocol {chosen} trains no classifier: no --classifier")
    given = click.get_current_context().get_parameter_source("per_gesture")
    if given is ParameterSource.COMMANDLINE and chosen not in COUNTED:
        raise click.UsageError(f"--per-gesture is of {', '.join(COUNTED)}; not of {chosen}")
    own = [*asked.pop("own")]
    for name, only in {"sampling": "kaspar", "network": "baxter"}.items():
        value = asked.pop(name)
        if value and chosen != only:
            raise click.UsageError(f"--{name} is of {only}; not of {chosen}")
        own[:0] = [f"{name}={value}"] if value else []
    asked["seeds"] = asked["seeds"] or SEEDS.get(chosen, 5)
    asked["variety"] = _variety(chosen, asked["variety"])
    evaluation = find_evaluation(chosen)
    settled = own_settings(evaluation.settings, chosen, own)
    with spread.open(f"evaluate {chosen}") as workers:
        settings = Settings(
            recordings=files, workers=workers, own=settled, pictures=out is not None, **asked
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
    usual = "none" if protocol in CLEAN else "wider" if protocol == "physics" else "wide"
    return variety_of(asked or usual)


def _protocol(protocol: str | None, recordings: tuple[Path, ...]) -> tuple[str, tuple[Path, ...]]:
    """The protocol and its recordings; a file may stand in either place."""
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
