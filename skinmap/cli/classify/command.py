"""`skinmap classify`: name the touches of a recording, or of what comes live."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from skinmap.cli.classify.classify_result import (
    ClassifyResult,
    LiveSummary,
    LiveTouch,
    NamedRow,
    health_lines,
)
from skinmap.commands import options
from skinmap.report.present import present
from skinmap.report.table import Table

SUFFIX = ".skinmodel"  # as `skinmap.recognition.model_file` has it; a test compares


@click.command("classify")
@click.argument("files", nargs=-1, required=True, metavar="[MODEL] SOURCE")
@options.robot_option
@options.part_option
@options.seconds_option("Stop after this time [s]; live sources only.")
@options.publish_option("pressures, contacts and labels", multiple=True)
@options.response_option
@options.calibration_option
@click.option(
    "--coverage",
    type=options.Number(0.0, 1.0, min_open=True, max_open=True),
    help="Promised share of touches whose set of names holds the truth, such as 0.9; sets look "
    "like `poke or edge`.",
)
@options.seed_option
@options.words(
    "--gesture",
    "gestures",
    "GESTURE",
    "Gestures of the source sim, with commas between; or four, eight, "
    "all, hand, other, time. May be repeated.  [default: four]",
)
@options.prints(ClassifyResult, live=(LiveTouch, LiveSummary))
def command(files: tuple[str, ...], coverage: float | None, as_json: bool, **how: Any) -> None:
    """Name touches with a confidence from 0 to 1.

    MODEL is what `skinmap train` wrote; without one the model that comes with Skinmap names the
    four still touches and the eight in time that are simulated, on any robot.

    SOURCE is a recording of marked touches (.npz, .mcap, or of other software with a mapping),
    whose names are compared with the recorded ones, or whatever can be followed: sim, lsl:NAME,
    zmq:HOST:PORT, a recording without marks (.mcap, .xdf, data.log), which gives a line a touch
    when it ends and a summary at the end; with --json each line is an object.

    Beside its name each touch has three answers, of the model that comes with Skinmap unless the
    given one has its own: kind (with what), motion (how it moves) and hand (hand, other or unsure).

    Several touches at once on one part are told apart and named each. `no_contact` is said where
    nothing is touched, `unknown` where the model is less sure than it was on held-out touches.

    With --calibration each touch has its force in newtons, area and pressures, all with intervals
    of 90 %, or why there is none: pressed harder than was calibrated, or a zero of another day.

    With --coverage 0.9 a touch gets the smallest set of names that holds the truth in nine of ten
    touches, by those that were held out in training: of the same skin where there were enough, else
    of other skins left out. Touches unlike those of the training have wider sets; where too little
    was held out a note says so, and sets hold all names. An empty set is `unknown`.

    \b
    Example:  skinmap classify touches.npz
              skinmap classify touch.skinmodel touches.npz --part right_forearm --json
              skinmap classify touch.skinmodel touches.npz --coverage 0.9
              skinmap classify touch.skinmodel lsl:demo --seconds 60 --json
              skinmap classify sim --gesture all,time --seconds 15 --json
              skinmap classify touch.mcap --calibration left_forearm=load
    """
    from skinmap.cli.classify.live_naming import classify_live, name_recorded
    from skinmap.recognition.model_file import load_classifier
    from skinmap.recognition.named_classifiers import default_model

    model, source = _model_and_source(files)
    source = _with_gestures(source, how.pop("gestures"))
    classifier = default_model() if model is None else load_classifier(model)
    if coverage is not None:
        classifier.promise(coverage)
    live = not holds_events(source)
    if live or how["publish"] or how["seconds"] is not None:
        classify_live(classifier, source, as_json=as_json, **how)
        return
    what = {name: how[name] for name in ("robot", "parts", "calibrations")}
    found = name_recorded(classifier, Path(source), **what)
    present(found, _lines, as_json=as_json)


def _model_and_source(files: tuple[str, ...]) -> tuple[Path | None, str]:
    """What names the touches, where that was said, and where they come from."""
    if len(files) > 2:
        raise click.UsageError(f"a model and one source, got {len(files)}: {' '.join(files)}")
    if len(files) == 2 and files[1].endswith(SUFFIX):
        raise click.UsageError(f"the model comes first: {files[1]} {files[0]}")
    if len(files) == 1 and files[0].endswith(SUFFIX):
        raise click.UsageError(f"{files[0]} is a model: name what it should classify behind it")
    return (None if len(files) == 1 else Path(files[0])), files[-1]


def _with_gestures(source: str, gestures: tuple[str, ...]) -> str:
    """A simulated source of these gestures; any other source has none to choose."""
    if not gestures:
        return source
    from skinmap.touch.simulation.hands import gesture_set

    if source != "sim":
        raise click.UsageError(f"--gesture is of the simulated source sim, not of {source}")
    return f"{source}:{','.join(gesture_set(gestures))}"


def holds_events(source: str) -> bool:
    """Whether a source is a recording of pressures whose touches were marked."""
    from skinmap.io.ros2.bag import is_mapped, whole

    path = whole(Path(source))
    if is_mapped(path):
        return False
    if not path.is_file():
        return path.suffix.lower() == ".npz"
    if path.suffix.lower() == ".mcap":
        from skinmap.io.mcap.reading import read_track

        track = read_track(path)
        return track.kind == "pressure" and len(track.touches) > 0
    from skinmap.io.recordings.touch_files import is_foreign, read_recordings

    if is_foreign(path) or path.suffix.lower() == ".npz":
        return any(one.labels for one in read_recordings(path))
    return False


def _lines(result: ClassifyResult) -> Iterator[str | Table]:
    from skinmap.recognition.classifier import Prediction
    from skinmap.recognition.naming import in_words

    def said(touch: NamedRow) -> str:
        names = None if touch.names is None else tuple(touch.names)
        return in_words(Prediction(touch.label, touch.confidence, names))

    rows = [replace(touch, label=said(touch)) for touch in result.touches]
    shown = "part event touch label confidence recorded_label=recorded"
    shown += " heading" if any(row.heading != "still" for row in rows) else ""
    shown += " force=force_(90_%)" if any(row.load is not None for row in rows) else ""
    yield Table.of(NamedRow, rows, shown)
    yield from health_lines(result.health)
    right = round((result.accuracy or 0.0) * result.events)
    yield f"{right} of {result.events} as recorded"
    if result.sets is not None and result.sets.held is not None:
        yield (
            f"{100 * result.sets.held:.1f} % of the sets hold the recorded name "
            f"({100 * result.sets.coverage:g} % asked for), {result.sets.mean_size:.2f} names each"
        )
