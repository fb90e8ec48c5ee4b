"""Check-ups that were kept: each taxel's baseline, noise and gain over months, and their changes.

The evidence of touches on gains (`gains`) adds up over the check-ups before and after a moment. The
gain of a taxel has changed where its difference departs from those of the taxels beside it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from calibration.wiring.gains import SPREAD, gains_told
from skinmap.arrays import FloatArray
from skinmap.errors import DataFormatError, OutputError
from skinmap.io.output import staged_file
from skinmap.report.page import plain_figure, save_figure

if TYPE_CHECKING:
    from calibration.wiring.examination import Case, Examination
    from calibration.wiring.findings import CheckupResult

SURE, WEAKER = 3.6, 0.15  # deviations that a change needs, and its least size [log]
WANDER = 0.03  # of gains between check-ups [log]
ROUNDS, DOUBT = 3, 2.5  # of judging: taxels so many deviations off are no measure for others
UNMET = 10.0  # precision below which nothing measured a gain
MOVED, NOISIER = 12.0, 3.0  # least change of a baseline [counts], and of a noise (times)
MOST_DRAWN = 400  # taxels of which each has a line of its own


class KeptTouch(msgspec.Struct, frozen=True):
    """Evidence of a touch on gains: rows (k), pull (k), precision (upper triangle by rows)."""

    rows: list[int]
    pull: list[float]
    precision: list[float]


class KeptPart(msgspec.Struct, frozen=True):
    """A part in a check-up; the lists have a number for each row of the taxel table."""

    channels: list[int]
    baseline: list[float]
    noise: list[float]
    gains: list[KeptTouch] = []


class KeptCheckup(msgspec.Struct, frozen=True):
    """A check-up as its file has it."""

    format: str
    time: str
    robot: str
    status: str
    faults: list[str]
    parts: dict[str, KeptPart]


@dataclass(frozen=True, slots=True)
class Change:
    """A taxel that is not what it was: its row in the table, and since when."""

    part: str
    row: int
    kind: str
    words: str
    confidence: float
    since: str


FORMAT = "skinmap check-up 1"


def earlier_checkups(folder: Path) -> list[KeptCheckup]:
    """The check-ups in a folder, the oldest first; none where there is no folder.

    Raises
    ------
    DataFormatError
        A damaged file.
    """
    found = []
    for path in sorted(folder.glob("checkup_*.json")):
        try:
            one = msgspec.json.decode(path.read_bytes(), type=KeptCheckup)
            datetime.fromisoformat(one.time)
        except (msgspec.MsgspecError, OSError, ValueError) as error:
            raise DataFormatError(f"not a kept check-up: {error}", path) from None
        if one.format != FORMAT or any(
            len({len(part.channels), len(part.baseline), len(part.noise)}) != 1
            or any(len(t.rows) != len(t.pull)
                   or len(t.precision) != len(t.rows) * (len(t.rows) + 1) // 2
                   or not all(0 <= r < len(part.channels) for r in t.rows) for t in part.gains)
            for part in one.parts.values()
        ):  # fmt: skip
            raise DataFormatError(f"not a kept check-up of format {FORMAT!r}", path)
        found.append(one)
    return found


def keep_checkup(
    folder: Path,
    before: Sequence[KeptCheckup],
    examined: Examination,
    result: CheckupResult,
    when: datetime,
) -> tuple[list[Change], list[str]]:
    """Write a check-up and its drawing beside those before; what has changed, and the files.

    Raises
    ------
    OutputError
        A check-up of this second is there already.
    """
    parts = {case.part: kept_part(case) for case in examined.cases if case.rest is not None}
    now = KeptCheckup(FORMAT, when.isoformat(timespec="seconds"), examined.robot,
                      result.status, [one.words for one in result.faults], parts)  # fmt: skip
    stem = folder / f"checkup_{when:%Y-%m-%dT%H-%M-%S}"
    if stem.with_suffix(".json").exists():
        raise OutputError(f"{stem!s}.json is there already: wait for a second")
    folder.mkdir(parents=True, exist_ok=True)
    with staged_file(stem.with_suffix(".json")) as stage:
        stage.write_bytes(msgspec.json.format(msgspec.json.encode(now), indent=1))
    changes: list[Change] = []
    courses = []
    for case in examined.cases:
        channels = case.boards.table.channels.tolist()
        times, own = checkups_of((*before, now), now.robot, case.part, channels)
        if len(times) > 1 and case.doctor.status != "inconsistent":
            found, gain = changes_of(case.part, times, own)
            changes += found
            courses.append((case.part, times, own, gain))
    files = [str(stem.with_suffix(".json"))]
    if courses:
        with staged_file(stem.with_suffix(".pdf")) as stage:
            save_figure(_drawing(courses, changes), stage)
        files.append(str(stem.with_suffix(".pdf")))
    return changes, files


def checkups_of(
    kept: Sequence[KeptCheckup], robot: str, part: str, channels: Sequence[int]
) -> tuple[list[str], list[KeptPart]]:
    """The times of check-ups that have a part with these channels, and the part in each."""
    found = [(one.time, one.parts[part]) for one in kept
             if one.robot == robot and part in one.parts
             and one.parts[part].channels == list(channels)]  # fmt: skip
    return [time for time, _ in found], [own for _, own in found]


def changes_of(
    part: str, times: Sequence[str], kept: Sequence[KeptPart]
) -> tuple[list[Change], FloatArray]:
    """The changes of a part's (n,) taxels over e check-ups, and their log gains (e, n)."""
    told = [_told(one.gains, len(one.channels)) for one in kept]
    gain = np.array([np.where(precision.diagonal() > UNMET, _gains(precision, pull)[0], np.nan)
                     for precision, pull in told])  # fmt: skip
    return [
        *_gain_changes(part, times, told),
        *_rest_changes(part, times, kept),
    ], gain


def kept_part(case: Case) -> KeptPart:
    """What is kept of a part: touches where its wiring is as mapped."""
    assert case.rest is not None
    wrong = [c for found in case.doctor.found for c in found.fault.channels(case.boards)]
    channels = case.boards.table.channels
    trusted = ~np.isin(channels, wrong)
    sound = case.doctor.status != "inconsistent"
    touches = []
    for touch in case.doctor.touches if sound else ():
        if (told := gains_told(case.boards, touch, trusted)) is not None:
            triangle = told.precision[np.triu_indices(len(told.rows))]
            touches.append(KeptTouch(told.rows.tolist(), np.round(told.pull, 1).tolist(),
                                     np.round(triangle, 1).tolist()))  # fmt: skip
    return KeptPart(channels.tolist(), np.round(case.rest.level, 2).tolist(),
                    np.round(case.rest.noise, 3).tolist(), touches)  # fmt: skip


def _told(touches: Sequence[KeptTouch], count: int) -> tuple[FloatArray, FloatArray]:
    """Precision (n, n) and pull (n,) that touches give together."""
    precision, pull = np.zeros((count, count)), np.zeros(count)
    for one in touches:
        own = np.zeros((len(one.rows), len(one.rows)))
        own[np.triu_indices(len(own))] = one.precision
        precision[np.ix_(one.rows, one.rows)] += own + np.triu(own, 1).T
        pull[one.rows] += one.pull
    return precision, pull


def _gains(precision: FloatArray, pull: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Logarithms of gains (n,) and their covariance (n, n)."""
    covariance = np.linalg.inv(precision + np.eye(len(pull)) / SPREAD**2)
    return covariance @ pull, np.asarray(covariance)


def _unlike_others(gap: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far each of (n,) differences lies from what the others let expect, and its deviations."""
    doubted = np.zeros(len(gap))
    for _ in range(ROUNDS):
        inverse = np.linalg.inv(covariance + np.diag(doubted))
        spread = 1.0 / inverse.diagonal()
        size = np.asarray(spread * (inverse @ gap))
        score = size / np.sqrt(np.maximum(spread - doubted, WANDER**2))
        score /= max(1.0, 1.4826 * float(np.median(np.abs(score))))
        doubted = np.where(np.abs(score) > DOUBT, 1.0, 0.0)
    return size, score


def _gain_changes(
    part: str, times: Sequence[str], told: Sequence[tuple[FloatArray, FloatArray]]
) -> Iterator[Change]:
    """Taxels whose gain is another one from a check-up on; two check-ups must show it."""
    size, best = np.zeros(len(told[0][1])), np.zeros(len(told[0][1]))
    first = np.zeros(len(best), np.int64)
    for split in range(1, len(times) - 1):
        old, new = ([sum(both) for both in zip(*some, strict=True)]
                    for some in (told[:split], told[split:]))  # fmt: skip
        before, unsure = _gains(*old)
        after, doubt = _gains(*new)
        met = (old[0].diagonal() > UNMET) & (new[0].diagonal() > UNMET)
        own, score = _unlike_others(after - before, unsure + doubt + WANDER**2 * np.eye(len(met)))
        better = met & (np.abs(score) > np.abs(best))
        best[better], size[better], first[better] = score[better], own[better], split
    for row in np.flatnonzero((np.abs(best) > SURE) & (np.abs(size) > WEAKER)).tolist():
        kind = "weaker" if size[row] < 0 else "stronger"
        words = f"{kind} by {abs(np.expm1(size[row])):.0%}"
        yield _change(part, row, kind, words, times[first[row]], 0.99)


def _rest_changes(part: str, times: Sequence[str], kept: Sequence[KeptPart]) -> Iterator[Change]:
    """Taxels whose baseline or noise is another one in the last check-up."""
    level = np.array([one.baseline for one in kept])
    rough = np.array([one.noise for one in kept])
    moved = level[-1] - np.median(level[:-1], axis=0)
    for row in np.flatnonzero(np.abs(moved - np.median(moved)) > MOVED).tolist():
        text = (
            f"its rest lies {abs(moved[row]):.0f} counts {'higher' if moved[row] > 0 else 'lower'}"
        )
        yield _change(part, row, "moved", text, times[-1], 0.95)
    usual = np.maximum(np.median(rough[:-1], axis=0), np.median(rough))
    for row in np.flatnonzero(rough[-1] > NOISIER * usual + 0.3).tolist():
        text = f"{rough[-1][row] / usual[row]:.1f} times as noisy"
        yield _change(part, row, "noisier", text, times[-1], 0.95)


def _change(part: str, row: int, kind: str, words: str, since: str, sure: float) -> Change:
    day = datetime.fromisoformat(since)
    return Change(part, row, kind, f"{words} since {day.day} {day:%B %Y}", sure, since)


def _drawing(
    courses: Sequence[tuple[str, list[str], list[KeptPart], FloatArray]], changes: Sequence[Change]
) -> object:
    """Baseline, noise and gain of each taxel over time; those that changed in colour."""
    figure = plain_figure((11.0, 2.2 + 2.4 * len(courses)))
    axes = figure.subplots(len(courses), 3, squeeze=False)
    for line, (part, times, kept, gain) in zip(axes, courses, strict=True):
        days = [datetime.fromisoformat(one) for one in times]
        changed = {one.row: kept[0].channels[one.row] for one in changes if one.part == part}
        drawn = {"rest [counts]": [one.baseline for one in kept],
                 "noise [counts]": [one.noise for one in kept],
                 "gain beside its neighbours": np.exp(gain)}  # fmt: skip
        for axis, (name, values) in zip(line, drawn.items(), strict=True):
            table = np.asarray(values)
            axis.plot(days, table[:, :MOST_DRAWN], ".-", color="#9fb0bd", lw=0.4, ms=2, alpha=0.6)
            for row, channel in list(changed.items())[:8]:
                axis.plot(days, table[:, row], ".-", lw=1.6, label=f"taxel {channel}")
            axis.set_title(f"{part}: {name}", loc="left", fontsize=9)
            axis.tick_params(axis="x", labelrotation=30, labelsize=7)
        if changed:
            line[0].legend(frameon=False, fontsize=7)
    return figure
