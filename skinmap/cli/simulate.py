"""`skinmap simulate`: simulated touches on the skin, as a recording or as a live stream."""

from __future__ import annotations

import time
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import click
from click.core import ParameterSource

from skinmap.commands.options import (
    MAX_TOUCHES,
    Number,
    open_robot,
    out_file,
    part_option,
    per_gesture_option,
    places_option,
    prints,
    publish_option,
    robot_argument,
    seconds_option,
    seed_option,
)
from skinmap.commands.profiles import profile_option
from skinmap.commands.progress import progress
from skinmap.errors import SkinWarning
from skinmap.report.present import present

SHARE, COUNTS = Number(0.0, 1.0), Number(0.0, 255.0)
# What can be said of the sensors instead of having it drawn: limits and help.
SENSING: dict[str, tuple[click.ParamType[Any], str]] = {
    "noise": (COUNTS, "Of a sample [counts]; 1.2 where nothing varies."),
    "drift": (COUNTS, "Of baselines [counts]; 0.5 where nothing varies."),
    "dead": (SHARE, "Share of taxels that always send 0."),
    "unplaced": (SHARE, "Share of modules whose channels have no place."),
    "stuck": (SHARE, "Share of taxels, side by side, that always send one value."),
    "spikes": (SHARE, "Chance that a taxel jumps in a sample."),
    "gaps": (Number(0.0, 0.5), "Share of samples that are lost, one to four at once."),
    "hysteresis": (SHARE, "Share of a fallen load by which readings stay higher."),
    "creep": (Number(0.0, 10.0), "Share by which readings still grow under a standing load."),
    "cross_talk": (SHARE, "Share of its module's mean that a taxel reads with its own."),
    "gain_spread": (Number(0.0, 10.0), "Spread of taxels' gains; 0.15 where nothing varies."),
    "foam_mm": (
        Number(0.0, 1000.0, min_open=True),
        "Spread by the foam; 2.5 where nothing varies.",
    ),
    "saturation": (COUNTS, "No taxel sends more counts; 255 by default."),
    "bits": (click.IntRange(1, 8), "Resolution; 8 by default."),
    "rate": (Number(0.0, 10_000.0, min_open=True), "Samples a second; 50 by default."),
}


@dataclass(frozen=True, kw_only=True, slots=True)
class SimulatedPart:
    """The touches of one part.

    Attributes
    ----------
    part
        Its name.
    samples
        Of its recording.
    touches
        How many by label.
    subjects
        People who touched it.
    """

    part: str
    samples: int
    touches: dict[str, int]
    subjects: int


@dataclass(frozen=True, kw_only=True, slots=True)
class SimulateResult:
    """A recording that was simulated.

    Attributes
    ----------
    robot, seed
        What it was made of.
    variety
        How far touches and sensors were drawn at random, 0 to 1.
    parts
        In the order of the recording.
    files
        The recording.
    """

    robot: str
    seed: int
    variety: float
    parts: list[SimulatedPart]
    files: list[str]


@dataclass(frozen=True, kw_only=True, slots=True)
class StreamResult:
    """A stream that was simulated, with `--publish`.

    Attributes
    ----------
    robot, seed
        What it was made of.
    publish
        Where to.
    kind
        What its values are.
    rate_hz
        Samples a second, as it was asked for.
    parts, channels
        Whose values it has, and how many.
    samples, seconds
        That went out, and how long that took.
    behind_s
        How late the last samples went out.
    touches
        How many by label.
    interrupted
        Whether Ctrl-C ended it.
    """

    robot: str
    seed: int
    publish: str
    kind: Literal["raw", "pressure"]
    rate_hz: float
    parts: list[str]
    channels: int
    samples: int
    seconds: float
    behind_s: float
    touches: dict[str, int]
    interrupted: bool


def sensing_options(command: Any) -> Any:
    """One option for each entry of `SENSING`."""
    for name, (kind, text) in reversed(SENSING.items()):
        command = click.option("--" + name.replace("_", "-"), type=kind, help=text)(command)
    return command


@click.command("simulate")
@robot_argument
@part_option
@per_gesture_option("Touches of each gesture on each part.")
@click.option(
    "--gesture",
    "gestures",
    metavar="GESTURE",
    multiple=True,
    help="Only this gesture; may be repeated. Or four (the default), eight, all, or time: "
    "strokes, pats, taps, rubs and more, with their true motion.",
)
@click.option(
    "--pairs",
    type=click.IntRange(1, MAX_TOUCHES),
    help="Instead, so many pairs of touches at once on each part, drawn from the gestures.",
)
@click.option(
    "--subjects",
    type=click.IntRange(1, MAX_TOUCHES),
    default=10,
    show_default=True,
    help="People who touch, each with a hand size and habits.",
)
@places_option()
@click.option(
    "--physics",
    type=click.Choice(["ours", "mujoco"]),
    default="ours",
    show_default=True,
    help="Who presses: our simulator, or MuJoCo on a bed of springs (extra 'mujoco').",
)
@click.option(
    "--variant",
    metavar="VARIANT",
    help="Of --physics mujoco: foam (the default), flesh, finger, ...",
)
@click.option(
    "--variety",
    metavar="none|some|wide|X",
    default="wide",
    show_default=True,
    help="How far touches and sensors are drawn at random: none (pads of fixed sizes on clean "
    "sensors), some, wide, or a number from 0 to 1.",
)
@sensing_options
@out_file("Recording to write: .npz or .mcap.", default="touches.npz")
@publish_option("touches without end instead of recording them")
@seconds_option("Stop after so long; with --publish only.")
@click.option("--raw", is_flag=True, help="Stream raw values, 240 at rest, instead of pressures.")
@seed_option
@profile_option("fidelity")
@prints(SimulateResult, StreamResult)
def command(
    robot: str,
    parts: tuple[str, ...],
    per_gesture: int,
    gestures: tuple[str, ...],
    pairs: int | None,
    physics: str,
    variant: str | None,
    output: Path,
    publish: str | None,
    seconds: float | None,
    raw: bool,
    seed: int,
    as_json: bool,
    subjects: int,
    places: Any,
    variety: str,
    **how: Any,
) -> None:
    """Simulate touches and write them with event numbers, labels and subjects, or stream them.

    With --variety none touches are pads of fixed sizes on clean sensors; else bodies with a force
    on an elastic skin, and sensors whose faults are drawn unless an option says them.

    \b
    Example:  skinmap simulate icub --part torso --per-gesture 30 -o torso.npz
              skinmap simulate icub --gesture eight --subjects 20 --dead 0.02 -o touches.npz
              skinmap simulate icub --variety none -o clean.npz
              skinmap simulate icub --part torso --pairs 50 -o pairs.npz
              skinmap simulate icub --physics mujoco --variant flesh -o flesh.npz
              skinmap simulate icub --rate 50 --publish lsl:demo
    """
    if variant is not None and physics != "mujoco":
        raise click.UsageError("--variant is for --physics mujoco")
    from skinmap.touch.variety import variety_of

    number = variety_of(variety)
    given = {name: value for name, value in how.items() if value is not None}
    if "foam_mm" in given:
        given["foam"] = given.pop("foam_mm") / 1e3
    if publish is not None:
        _refuse_given("per_gesture", "pairs", "output", "subjects", "places", "physics")
        streamed = publish_touches(
            robot, parts, publish, gestures=gestures, seconds=seconds, raw=raw, seed=seed,
            variety=number, sensing=given,
        )  # fmt: skip
        present(streamed, _stream_lines, as_json=as_json)
        return
    if seconds is not None or raw:
        raise click.UsageError("--seconds and --raw are for streams: add --publish")
    if physics == "mujoco":
        _refuse_given(
            "pairs", "places", "foam_mm", "variety", why="--physics mujoco has its own; leave out"
        )
    if pairs is not None and places != "anywhere":
        raise click.UsageError("--pairs are made anywhere on the skin; leave out --places")
    result = work(
        robot, parts, output, per_gesture=per_gesture, gestures=gestures, pairs=pairs, seed=seed,
        subjects=subjects, places=places, variety=number, sensing=given, physics=physics,
        variant=variant,
    )  # fmt: skip
    asked = per_gesture if pairs is None else 0
    present(result, lambda one: _lines(one, asked), as_json=as_json)


def work(
    robot: str,
    parts: tuple[str, ...],
    output: Path,
    *,
    per_gesture: int,
    gestures: tuple[str, ...],
    pairs: int | None,
    subjects: int,
    places: Any,
    variety: float,
    sensing: Mapping[str, Any],
    physics: str = "ours",
    variant: str | None = None,
    seed: int,
) -> SimulateResult:
    """Simulate touches on all parts and write them."""
    import numpy as np

    from skinmap.io.output import staged_file
    from skinmap.io.recordings.touch_files import check_suffix, save_recordings
    from skinmap.physics.simulation import simulate as press
    from skinmap.physics.variants import DEFAULT
    from skinmap.touch.gestures import gesture_set
    from skinmap.touch.pairs import simulate_pairs
    from skinmap.touch.simulator import check_gestures, simulate
    from skinmap.touch.variety import draw_sensing

    check_suffix(output)
    loaded, names = open_robot(robot, parts)
    wanted = gesture_set(gestures)
    check_gestures(wanted)
    shared: dict[str, Any] = {"gestures": wanted, "subjects": subjects}
    steps = len(names) * (pairs or len(wanted) * per_gesture)
    recordings = []
    with staged_file(output) as stage, progress(steps, "simulating") as advance:
        shared["progress"] = advance
        for name, rng in zip(names, np.random.default_rng(seed).spawn(len(names)), strict=True):
            skin = loaded.skin(name)
            answers = draw_sensing(0.0 if physics == "mujoco" else variety, rng=rng)
            shared["sensing"] = replace(answers, **sensing)
            if pairs is not None:
                recordings.append(
                    simulate_pairs(skin, count=pairs, rng=rng, variety=variety, **shared)
                )
                continue
            if physics == "mujoco":
                chosen: dict[str, Any] = {"variant": variant or DEFAULT, "per_gesture": per_gesture}
                recordings.append(press(skin, rng=rng, **chosen, **shared))
                continue
            more = {"per_gesture": per_gesture, "places": places}
            recordings.append(simulate(skin, rng=rng, variety=variety, **more, **shared))
        save_recordings(recordings, stage, robot=loaded)
    if physics == "mujoco" and output.suffix.lower() != ".npz":
        warnings.warn(
            f"only .npz keeps the true force and place of each sample, {output.name} does not",
            SkinWarning,
            stacklevel=2,
        )
    rows = [
        SimulatedPart(
            part=recording.part,
            samples=len(recording.times),
            touches=_counts(recording.labels, wanted if pairs is None else ()),
            subjects=len(set(recording.subjects.tolist())),
        )
        for recording in recordings
    ]
    return SimulateResult(
        robot=loaded.name, seed=seed, variety=variety, parts=rows, files=[str(output)]
    )


def _lines(result: SimulateResult, asked: int) -> Iterator[str]:
    for row in result.parts:
        counts = ", ".join(
            f"{count} {name}" + (f" (no room for {asked})" if count < asked else "")
            for name, count in row.touches.items()
        )
        yield f"{row.part}: {row.samples} samples, {counts or 'no touch fits'}"


def _stream_lines(result: StreamResult) -> Iterator[str]:
    touches = sum(result.touches.values())
    yield f"{result.samples} samples in {result.seconds:.1f} s, {touches} touches"


def _refuse_given(
    *names: str, why: str = "--publish streams touches without end; leave out"
) -> None:
    """Refuse options that make no sense here, where the user gave them."""
    context = click.get_current_context()
    default = (ParameterSource.DEFAULT, ParameterSource.DEFAULT_MAP)
    for option in context.command.params:
        if option.name in names and context.get_parameter_source(option.name) not in default:
            raise click.UsageError(f"{why} {option.opts[-1]}")


def _counts(labels: tuple[str, ...], wanted: tuple[str, ...]) -> dict[str, int]:
    """How many of each label, those that were wanted first."""
    names = dict.fromkeys([*wanted, *sorted(labels)])
    return {name: labels.count(name) for name in names}


def publish_touches(
    robot: str,
    parts: tuple[str, ...],
    spec: str,
    *,
    gestures: Sequence[str],
    seconds: float | None,
    raw: bool,
    seed: int,
    variety: float,
    sensing: Mapping[str, Any],
) -> StreamResult:
    """Stream touches until `seconds` have passed or Ctrl-C comes, then say what was sent."""
    import numpy as np

    from skinmap.live.publishing.publish import open_publisher, stream
    from skinmap.live.sources.simulator import SimulatedSource
    from skinmap.touch.gestures import gesture_set
    from skinmap.touch.variety import draw_sensing

    loaded, names = open_robot(robot, parts)
    answers = replace(draw_sensing(variety, rng=np.random.default_rng(seed)), **sensing)
    source = SimulatedSource(
        loaded,
        parts=names,
        seed=seed,
        kind="raw" if raw else "pressure",
        gestures=gesture_set(gestures),
        variety=variety,
        sensing=answers,
        seconds=float("inf") if seconds is None else seconds,
    )
    interrupted, began = False, time.perf_counter()
    try:
        info = source.info
        with open_publisher(spec, info, topics=(info.kind,), robot=loaded) as publisher:
            until = "ends by itself" if seconds is not None else "Ctrl-C ends it"
            click.echo(
                f"publishing {info.channels} channels of {loaded.name} at {info.rate:g} Hz as "
                f"{spec}; {until}",
                err=True,
            )
            began = time.perf_counter()
            try:
                stream(source, publisher)
            except KeyboardInterrupt:
                interrupted = True
            took = time.perf_counter() - began
            sent = publisher.sent
    finally:
        source.close()
    played = sent / info.rate
    labels = Counter(touch.label for touch in source.truth if touch.began < played)
    return StreamResult(
        robot=loaded.name,
        seed=seed,
        publish=spec,
        kind=info.kind,
        rate_hz=info.rate,
        parts=list(names),
        channels=info.channels,
        samples=sent,
        seconds=took,
        behind_s=max(0.0, took - played),
        touches=labels,
        interrupted=interrupted,
    )
