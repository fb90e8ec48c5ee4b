"""`skinmap classify` on what comes live: an object a touch, and a summary."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinmap.cli.classify.result import Health, Latency, LiveSummary, LiveTouch
from skinmap.commands.options import open_robot
from skinmap.live.sources.sample_counts import Counts
from skinmap.report.present import emit_line, object_of

if TYPE_CHECKING:
    from skinmap.classify.classifier import TouchClassifier
    from skinmap.live.contacts.contact_motion import Method
    from skinmap.live.contacts.events import TouchEvent
    from skinmap.live.loop import TouchLoop
    from skinmap.live.sources.source import Source
    from skinmap.touch.grouping import GroupingRule

WAIT = 0.2  # so often a silent source lets an interruption through [s]
LATENCIES = 100_000  # the last ones, that the summary speaks of
MM = 1e3
FEW = 8  # channels that a line names


def classify_live(
    classifier: TouchClassifier,
    spec: str,
    *,
    robot: str | None,
    parts: tuple[str, ...],
    rule: GroupingRule,
    seconds: float | None,
    seed: int,
    publish: Sequence[str],
    responses: Sequence[str],
    window: float,
    motion: Method,
    as_json: bool,
) -> None:
    """Name touches until the source ends, the seconds are over or the user interrupts.

    Raises
    ------
    SkinError
        A source, calibration or model that does not fit.
    """
    from skinmap.live.loop import TouchLoop
    from skinmap.live.response.files import load_responses
    from skinmap.live.sources.open_source import open_source
    from skinmap.live.sources.source import is_live
    from skinmap.touch.prepared_skin import PreparedSkin

    loaded, _ = open_robot(robot, parts)
    chosen = parts or None
    # A recording that nobody follows is named as fast as it goes.
    ahead = Path(spec).exists() and not publish

    def open_it() -> Source:
        speed = float("inf") if ahead else 1.0
        return open_source(spec, robot=loaded, parts=chosen, seed=seed, speed=speed)

    source = open_it()
    try:
        skins = {part: PreparedSkin(loaded.skin(part)) for part in source.info.parts}
        loop = TouchLoop(
            loaded,
            source,
            classifier=classifier,
            responses=load_responses(responses, skins),
            parts=chosen,
            skins=skins,
            rule=rule,
            reopen=open_it,
            window=window,
            motion=motion,
            singly=not is_live(source),  # so that it ends at the very sample
        )
        _note_differences(classifier, loop)
        run = _Run(loop, spec, classifier.name, as_json=as_json)
        publishers = _publish(loop, publish)
    except BaseException:
        source.close()
        raise
    try:
        run.until(seconds)
    except KeyboardInterrupt:
        click.echo("interrupted", err=True)
    finally:
        loop.close()
        for publisher in publishers:
            publisher.close()
    run.summarise()


class _Run:
    """Prints what the loop finds."""

    def __init__(self, loop: TouchLoop, spec: str, classifier: str, *, as_json: bool) -> None:
        self.loop, self.spec, self.classifier, self.as_json = loop, spec, classifier, as_json
        self.touches = 0
        self.latencies: deque[float] = deque(maxlen=LATENCIES)
        self.first = self.last = float("nan")

    def until(self, seconds: float | None) -> None:
        """Step until the source ends or has been followed for so long [s]."""
        from skinmap.live.sources.source import SourceEnded

        started = time.perf_counter()
        stale = False
        while True:
            try:
                moment = self.loop.step(WAIT)
            except SourceEnded:
                break
            finally:
                self._tell_touches()
            if moment is not None:
                if moment.stale != stale:
                    stale = moment.stale
                    what = "nothing comes from" if stale else "samples come again from"
                    click.echo(f"{what} {self.spec}", err=True)
                if not stale:
                    self.latencies.append(moment.latency)
                    self.first = moment.time if self.first != self.first else self.first
                    self.last = moment.time
            if seconds is not None and _passed(self, started) >= seconds:
                break
        self.loop.finish()
        self._tell_touches()

    def _tell_touches(self) -> None:
        from skinmap.classify.classifier import Prediction
        from skinmap.classify.naming import in_words
        from skinmap.live.contacts.named_touch import UNNAMED

        self.loop.happenings()
        for touch in self.loop.finished():
            if touch.label == UNNAMED and not self.loop.live:
                continue  # all samples were named from, and nobody's touch was among these
            self.touches += 1
            said = Prediction(touch.label, touch.confidence, touch.names)
            if self.as_json:
                emit_line(touch_line(touch))
            else:
                click.echo(
                    f"{touch.began:9.2f} s  {touch.part:18} {in_words(said):14} "
                    f"{touch.confidence:5.2f}  {touch.duration:6.2f} s  "
                    f"{touch.area * MM**2:7.0f} mm2  {touch.path_length * MM:6.1f} mm"
                    f"{motion_words(touch)}"
                )

    def summarise(self) -> None:
        """Print the last line."""
        import numpy as np

        late = np.array(self.latencies) * 1e3
        shares = [float(np.percentile(late, k)) if len(late) else None for k in (50, 99, 100)]
        summary = LiveSummary(
            source=self.spec,
            classifier=self.classifier,
            parts=list(self.loop.skins),
            touches=self.touches,
            seconds=self.last - self.first,
            rate_hz=self.loop.info.rate,
            latency_ms=Latency(median=shares[0], p99=shares[1], max=shares[2]),
            counts=Counts(**self.loop.totals()),
            health={part: Health(**found) for part, found in self.loop.health().items()},
        )
        if self.as_json:
            emit_line(object_of(summary))
            return
        for line in health_lines(summary.health):
            click.echo(line)
        median = "-" if shares[0] is None else f"{shares[0]:.1f}"
        click.echo(
            f"{self.touches} touches in {summary.counts.used} samples, "
            f"{summary.counts.lost} lost; {median} ms from a sample to its labels (median)"
        )


def health_lines(health: Mapping[str, Health]) -> Iterator[str]:
    """One line for each kind of ill taxels of a part."""
    for part, found in health.items():
        for state in ("stuck", "noisy"):
            channels = getattr(found, state)
            more = f" and {len(channels) - FEW} more" if len(channels) > FEW else ""
            if channels:
                named = ", ".join(map(str, channels[:FEW]))
                yield f"{part}: {len(channels)} {state} (channels {named}{more})"


def motion_words(touch: TouchEvent) -> str:
    """Where it went and how fast, or how often it was pressed; nothing of what stayed."""
    said = ""
    if touch.heading != "still":
        said += f"  {touch.heading}, {touch.speed * MM:.0f} mm/s"
    if touch.presses > 1:
        said += f"  {touch.presses} times, {1.0 / touch.period:.1f} a second"
    return said


def touch_line(touch: TouchEvent) -> LiveTouch:
    """What is said of a touch that is over."""
    return LiveTouch(
        touch=touch.identity,
        part=touch.part,
        label=touch.label,
        confidence=touch.confidence,
        names=None if touch.names is None else list(touch.names),
        start_s=touch.began,
        duration_s=touch.duration,
        area_mm2=touch.area * MM**2,
        path_mm=touch.path_length * MM,
        peak=touch.peak,
        centre_mm=(touch.centre * MM).tolist(),
        contacts=touch.contacts,
        heading=touch.heading,
        up_mm=touch.up * MM,
        right_mm=touch.right * MM,
        speed_mm_s=touch.speed * MM,
        presses=touch.presses,
        period_s=touch.period if touch.presses > 1 else None,
        early_label=touch.early or None,
        early_s=touch.early_after if touch.early else None,
    )


def _passed(run: _Run, started: float) -> float:
    """Seconds of the stream; where it is live, or of the clock on the wall if nothing comes."""
    stream = run.last - run.first
    wall = time.perf_counter() - started if run.loop.live else 0.0
    return max(wall, stream if stream == stream else 0.0)


def _publish(loop: TouchLoop, specs: Sequence[str]) -> list[Any]:
    """Publishers of the moments, each a subscriber of the loop."""
    if not specs:
        return []
    from skinmap.live.publishing.publish import open_publisher

    found: list[Any] = []
    try:
        for spec in specs:
            found.append(open_publisher(spec, loop.dense_info(), robot=loop.robot))
            loop.subscribe(found[-1].send)
    except BaseException:
        for publisher in found:
            publisher.close()
        raise
    return found


def _note_differences(classifier: TouchClassifier, loop: TouchLoop) -> None:
    """Say in one line on which parts the model has not learnt."""
    found = {part: classifier.difference(one.skin).message for part, one in loop.skins.items()}
    strange = [part for part, message in found.items() if message]
    if len(strange) == 1:
        click.echo(f"note: {found[strange[0]]}", err=True)
    elif strange:
        click.echo(f"note: the model did not learn on {', '.join(strange)}", err=True)
