"""`skinmap simulate`: simulated touches on the skin, as a recording or as a live stream."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import click
from click.core import ParameterSource

from skinmap.commands import options
from skinmap.commands.overwriting import protect
from skinmap.commands.progress import progress
from skinmap.errors import UnknownNameError, check_known, warn
from skinmap.io.output import staged_file
from skinmap.report.present import present

PHYSICS = ("ours", "mujoco")
PAIRS = "pairs"
SHARE, TIMES, COUNTS = (options.Number(0.0, most) for most in (1.0, 10.0, 255.0))
# What can be said of the sensors instead of having it drawn (docs/simulator.md).
SENSING: dict[str, click.ParamType[Any]] = {
    "noise": COUNTS, "drift": COUNTS, "dead": SHARE, "unplaced": SHARE, "stuck": SHARE,
    "spikes": SHARE, "gaps": options.Number(0.0, 0.5), "hysteresis": SHARE, "creep": TIMES,
    "compression": TIMES, "cross-talk": SHARE, "gain-spread": TIMES,
    "foam-mm": options.Number(0.0, 1000.0, min_open=True), "saturation": COUNTS,
    "bits": options.Whole(1, 8), "rate": options.Number(0.0, 10_000.0, min_open=True),
    "raw": click.BOOL,  # values of a stream as sensors send them, 240 at rest
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, slots=True)
class SimulatedPart:
    """The touches of one part.

    Attributes
    ----------
    part
        Name of the part.
    samples
        Number of samples of its recording.
    touches
        Number of touches by label.
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
    robot
        Name of the robot.
    seed
        Seed of the random numbers.
    variety
        Random spread of touches and sensors, 0 to 2.
    parts
        In the order of the recording.
    files
        Name of the recording.
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
    robot
        Name of the robot.
    seed
        Seed of the random numbers.
    publish
        Address of the stream.
    kind
        Kind of the values, raw or pressure.
    rate_hz
        Samples a second, as it was asked for.
    parts
        Names of the published parts.
    channels
        Total number of channels.
    samples
        Number of samples sent.
    seconds
        Duration of the stream.
    behind_s
        Delay of the last samples.
    touches
        Number of touches by label.
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


def _faults(ctx: click.Context, param: click.Parameter, given: tuple[str, ...]) -> dict[str, Any]:
    """Values of `--fault NAME=VALUE` by name."""
    found = {}
    for one in given:
        name, _, value = one.partition("=")
        check_known("fault", [name], SENSING)
        found[name] = SENSING[name].convert(value, param, ctx)
    return found


def _physics(ctx: click.Context, param: click.Parameter, given: str) -> tuple[str, str]:
    """The physics of the touches, and its variant in MuJoCo."""
    from skinmap.physics.variants import DEFAULT, VARIANTS

    physics, _, variant = given.partition(":")
    if physics not in PHYSICS or (variant and physics != "mujoco"):
        raise UnknownNameError("physics", given, [*PHYSICS, "mujoco:VARIANT"])
    if variant and variant not in VARIANTS:
        raise UnknownNameError("physics variant", variant, VARIANTS)
    return physics, variant or DEFAULT


@click.command("simulate")
@options.robot_argument
@options.part_option
@options.per_gesture_option("Touches of each gesture on each part.")
@options.words(
    "--gesture",
    "gestures",
    "GESTURE",
    "Gestures, with commas between; or four, eight, all, hand, other, time (strokes, pats, "
    "taps and more, with their true motion). May be repeated. With pairs, two of them at once.  "
    "[default: four]",
)
@options.word(
    "--physics",
    "ours|mujoco[:VARIANT]",
    "Physics of the touches: ours, or MuJoCo on a bed of springs (extra 'mujoco') of "
    "foam, flesh, finger, ...",
    shown="ours",
    callback=_physics,
)
@options.word(
    "--variety",
    "none|some|wide|wider|X",
    "Random spread of touches and sensors: none (pads of fixed sizes on clean "
    "sensors), some, wide, wider, or a number from 0 to 2.",
    shown="wide",
)
@options.words(
    "--fault",
    "faults",
    "NAME=VALUE",
    f"Fault of the sensors, instead of a random one; may be repeated. {', '.join(SENSING)}.",
    callback=_faults,
)
@options.out_file("Recording to write: .npz or .mcap.", default="touches.npz", guarded=False)
@options.publish_option("endless touches instead of recording them")
@options.seconds_option("Stop after this time [s]; with --publish only.")
@options.seed_option
@options.prints(SimulateResult, StreamResult)
def command(
    per_gesture: int,
    gestures: tuple[str, ...],
    physics: tuple[str, str],
    output: Path,
    publish: str | None,
    seconds: float | None,
    as_json: bool,
    variety: str,
    faults: dict[str, Any],
    **where: Any,
) -> None:
    """Simulate touches and write them with event numbers, labels and subjects, or stream them.

    With --variety none touches are pads of fixed sizes on clean sensors; else bodies with a force
    on an elastic skin, and sensors whose faults are drawn unless --fault gives them.

    \b
    Example:  skinmap simulate icub --part torso --per-gesture 30 -o torso.npz
              skinmap simulate icub --gesture eight --fault dead=0.02 -o touches.npz
              skinmap simulate icub --variety none -o clean.npz
              skinmap simulate icub --part torso --gesture pairs --per-gesture 50 -o pairs.npz
              skinmap simulate icub --physics mujoco:flesh -o flesh.npz
              skinmap simulate icub --publish lsl:demo
    """
    from skinmap.touch.simulation.variety import variety_of

    gestures = tuple(name.strip() for one in gestures for name in one.split(","))
    mujoco, paired = physics[0] == "mujoco", PAIRS in gestures
    where["variety"] = variety_of(variety)
    where["gestures"] = tuple(one for one in gestures if one != PAIRS)
    if paired and (mujoco or publish is not None):
        raise click.UsageError("pairs are of our own simulator, and recorded: leave out pairs")
    raw = bool(faults.pop("raw", False))
    given = {name.replace("-", "_"): value for name, value in faults.items()}
    if "foam_mm" in given:
        given["foam"] = given.pop("foam_mm") / 1e3
    where["sensing"] = given
    if publish is not None:
        _refuse_given("per_gesture", "output", "physics")
        streamed = publish_touches(publish, seconds=seconds, raw=raw, **where)
        present(streamed, _stream_lines, as_json=as_json)
        return
    if seconds is not None or raw:
        raise click.UsageError("--seconds and --fault raw are for streams: add --publish")
    if mujoco:
        why = "--physics mujoco has its own; leave out"
        _refuse_given("variety", why=why)
        if "foam" in given:
            raise click.UsageError(f"{why} --fault foam-mm")
    protect(output)
    result = work(
        output, per_gesture=per_gesture, paired=paired,
        variant=physics[1] if mujoco else None, **where,
    )  # fmt: skip
    asked = 0 if paired else per_gesture
    present(result, lambda one: _lines(one, asked), as_json=as_json)


def work(
    output: Path,
    *,
    robot: str,
    parts: tuple[str, ...],
    per_gesture: int,
    gestures: tuple[str, ...],
    paired: bool,
    variety: float,
    sensing: Mapping[str, Any],
    variant: str | None,
    seed: int,
) -> SimulateResult:
    """Simulate touches on all parts and write them; a `variant` is of MuJoCo's physics."""
    import numpy as np

    from skinmap.io.recordings.touch_files import check_suffix, save_recordings
    from skinmap.physics.simulation import simulate as press
    from skinmap.touch.simulation.hands import gesture_set
    from skinmap.touch.simulation.simulator import simulate, simulate_pairs
    from skinmap.touch.simulation.variety import draw_sensing

    check_suffix(output)
    loaded, names = options.open_robot(robot, parts)
    wanted = gesture_set(gestures)
    steps = len(names) * per_gesture * (1 if paired else len(wanted))
    recordings = []
    with staged_file(output) as stage, progress(steps, "simulating") as advance:
        shared: dict[str, Any] = {"gestures": wanted, "progress": advance}
        for name, rng in zip(names, np.random.default_rng(seed).spawn(len(names)), strict=True):
            skin = loaded.skin(name)
            answers = draw_sensing(0.0 if variant else variety, rng=rng)
            own = {"rng": rng, "sensing": replace(answers, **sensing), **shared}
            if paired:
                made = simulate_pairs(skin, count=per_gesture, variety=variety, **own)
            elif variant is not None:
                made = press(skin, per_gesture=per_gesture, variant=variant, **own)
            else:
                made = simulate(skin, per_gesture=per_gesture, variety=variety, **own)
            recordings.append(made)
        save_recordings(recordings, stage, robot=loaded)
    if variant is not None and output.suffix.lower() != ".npz":
        warn(f"only .npz keeps the true force and place of each sample, {output.name} does not")
    rows = [
        SimulatedPart(
            part=recording.part,
            samples=len(recording.times),
            touches=_counts(recording.labels, () if paired else wanted),
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
            f"{count} {name}" + (f" ({asked - count} do not fit)" if count < asked else "")
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
    spec: str,
    *,
    robot: str,
    parts: tuple[str, ...],
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
    from skinmap.live.sources.simulated_source import SimulatedSource
    from skinmap.touch.simulation.hands import gesture_set
    from skinmap.touch.simulation.variety import draw_sensing

    loaded, names = options.open_robot(robot, parts)
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
    info = source.info
    with (
        closing(source),
        open_publisher(spec, info, topics=(info.kind,), robot=loaded) as publisher,
    ):
        until = "ends by itself" if seconds is not None else "Ctrl-C ends it"
        click.echo(
            f"publishing {info.channels} channels of {loaded.name} at {info.rate:g} Hz as "
            f"{spec}; {until}",
            err=True,
        )
        began = time.perf_counter()
        _, interrupted = stream(source, publisher)
        took = time.perf_counter() - began
        sent = publisher.sent
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
