"""Check-ups that were kept: each taxel's baseline, noise and gain over months, and their changes.

The evidence of touches on gains (`touches`) adds up over the check-ups before and after a moment.
The gain of a taxel has changed where its difference departs from those of the taxels beside it.

The page of a check-up names its faults, and marks them on the parts.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from calibration.wiring.findings import WORDS, CheckupResult, lines
from calibration.wiring.touches import GAINS, gains_told
from skinmap.arrays import BoolArray, FloatArray, IntArray
from skinmap.errors import DataFormatError, OutputError, SkinError
from skinmap.io.output import staged_file
from skinmap.report.page import draw_channels, plain_figure, save_figure

if TYPE_CHECKING:
    from calibration.wiring.examination import Case, Examination
    from skinmap.skin.robot import Robot

SURE, WEAKER = 3.6, 0.15  # deviations that a change needs, and its least size [log]
WANDER = 0.03  # of gains between check-ups [log]
ROUNDS, DOUBT = 3, 2.5  # of judging: taxels so many deviations off are no measure for others
UNMET = 10.0  # precision below which nothing measured a gain
STRAY = 5.0  # times that touches disagree more about a taxel than before: not about its gain
PRIOR = 4  # degrees of freedom of what all taxels show of the scatter between strokes
MOVED, NOISIER = 12.0, 3.0  # least change of a baseline [counts], and of a noise (times)
UNTOLD = 0.1  # share of taxels whose gain cannot be compared that deserves a note
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


class History(NamedTuple):
    """What a check-up shows beside those before: changes, notes, check-ups compared, files."""

    changes: list[Change]
    notes: list[str]
    compared: int
    files: list[str]


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
AWAY = "Move it out of the folder"


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
            raise DataFormatError(f"not a kept check-up: {error}. {AWAY}", path) from None
        if one.format != FORMAT or any(
            len({len(part.channels), len(part.baseline), len(part.noise)}) != 1
            or any(len(t.rows) != len(t.pull)
                   or len(t.precision) != len(t.rows) * (len(t.rows) + 1) // 2
                   or not all(0 <= r < len(part.channels) for r in t.rows) for t in part.gains)
            for part in one.parts.values()
        ):  # fmt: skip
            raise DataFormatError(f"not a kept check-up of format {FORMAT!r}. {AWAY}", path)
        if datetime.fromisoformat(one.time).tzinfo is None:
            one = msgspec.structs.replace(one, time=f"{one.time}+00:00")
        found.append(one)
    found.sort(key=lambda one: datetime.fromisoformat(one.time))
    return found


def keep_checkup(
    folder: Path,
    before: Sequence[KeptCheckup],
    examined: Examination,
    result: CheckupResult,
    when: datetime,
) -> History:
    """Write a check-up and its drawing beside those before.

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
        raise OutputError(f"{stem!s}.json is there already: this recording, or a check-up of the "
                          f"same second, was kept before")  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    with staged_file(stem.with_suffix(".json")) as stage:
        stage.write_bytes(msgspec.json.format(msgspec.json.encode(now), indent=1))
    changes: list[Change] = []
    courses = []
    notes = []
    if later := [one for one in before if datetime.fromisoformat(one.time) > when]:
        notes.append(f"{len(later)} later check-ups of the history are not compared")
        before = [one for one in before if one not in later]
    compared = 1
    for case in examined.cases:
        channels = case.boards.table.channels.tolist()
        times, own = checkups_of((*before, now), now.robot, case.part, channels)
        compared = max(compared, len(times))
        if other := len(before) - len(checkups_of(before, now.robot, case.part, channels)[0]):
            notes.append(f"{case.part} is not in {other} of the earlier check-ups, or they are of "
                         f"another robot or other channels")  # fmt: skip
        if len(times) > 1 and case.doctor.status != "inconsistent":
            found, gain = changes_of(case.part, times, own)
            changes += found
            courses.append((case.part, times, own, gain))
            unmet = np.isnan(gain[-1]) | np.isnan(gain[:-1]).all(axis=0)
            if unmet.mean() > UNTOLD and len(times) > 2:
                notes.append(f"too few strokes to compare the gain of {unmet.sum()} of "
                             f"{len(unmet)} taxels of {case.part} with earlier ones")  # fmt: skip
    files = [str(stem.with_suffix(".json"))]
    if courses:
        with staged_file(stem.with_suffix(".pdf")) as stage:
            save_figure(_drawing(courses, changes), stage)
        files.append(str(stem.with_suffix(".pdf")))
    return History(changes, notes, compared, files)


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
    sides = [_Side.of([one]) for one in kept]
    gain = np.array([np.where(one.met, one.gains, np.nan) for one in sides])
    return [*_gain_changes(part, times, kept), *_rest_changes(part, times, kept)], gain


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


class _Side(NamedTuple):
    """Log gains (n,) by the touches of some check-ups, as precise as these touches agree."""

    gains: FloatArray
    covariance: FloatArray  # (n, n) where the model of a touch is right
    scatter: FloatArray  # (n,) variance by the touches' own disagreement
    freedom: FloatArray  # (n,) touches that met a taxel, less one
    met: BoolArray

    @classmethod
    def of(cls, kept: Sequence[KeptPart]) -> _Side:
        """Evidence of all touches together."""
        touches = [touch for one in kept for touch in one.gains]
        count = len(kept[0].channels)
        precision, pull = np.zeros((count, count)), np.zeros(count)
        for one in touches:
            precision[np.ix_(one.rows, one.rows)] += _square(one)
            pull[one.rows] += one.pull
        covariance = np.asarray(np.linalg.inv(precision + np.eye(len(pull)) / GAINS**2), float)
        gains = covariance @ pull
        scatter, meet = np.zeros(len(pull)), np.zeros(len(pull))
        for one in touches:
            own = _square(one)
            off = np.asarray(one.pull) - own @ gains[one.rows]
            scatter += (covariance[:, one.rows] @ off) ** 2
            meet[one.rows] += own.diagonal() > 1.0
        freedom = np.maximum(meet - 1.0, 0.0)
        scatter *= meet / np.maximum(freedom, 1.0)
        return cls(gains, covariance, scatter, freedom, precision.diagonal() > UNMET)

    def stray(self, row: int) -> float:
        """How much more its touches disagree about a taxel than those of the others."""
        excess = self.scatter / self.covariance.diagonal()
        return float(excess[row] / max(1.0, np.median(excess[self.met])))


def _square(touch: KeptTouch) -> FloatArray:
    """Precision (k, k) of a touch."""
    own = np.zeros((len(touch.rows), len(touch.rows)))
    own[np.triu_indices(len(own))] = touch.precision
    return own + np.triu(own, 1).T


def _compared(old: _Side, new: _Side) -> tuple[FloatArray, FloatArray]:
    """Changes (n,) of log gains beside those of the other taxels, and their normal scores.

    The precision of a touch holds where its model does. Where touches of one side disagree more,
    the variance grows as they do: each taxel's own, drawn to that of all by `PRIOR`.
    """
    covariance = old.covariance + new.covariance
    freedom, met = old.freedom + new.freedom, old.met & new.met
    excess = (old.scatter + new.scatter) / covariance.diagonal()
    judged = excess[met & (freedom > 0)]
    usual = np.minimum(judged, 3.0 * np.median(judged)).mean() if len(judged) else 1.0
    grown = (freedom * excess + PRIOR * usual) / (freedom + PRIOR)
    grown = np.sqrt(np.maximum(grown, 1.0))
    covariance = covariance * np.outer(grown, grown) + WANDER**2 * np.eye(len(met))
    size, score = _unlike_others(new.gains - old.gains, covariance)
    normal = norm.isf(student.sf(np.abs(score), freedom + PRIOR))
    return size, np.where(met, normal, 0.0)


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


def _gain_changes(part: str, times: Sequence[str], kept: Sequence[KeptPart]) -> Iterator[Change]:
    """Taxels whose gain is another one from a check-up on; two check-ups must show it.

    One that is back at the gain of the first check-ups has recovered. Where the touches that met
    it disagree as they did not before, it feels another place, which bends the fits of strokes
    beside it: the gains of others are not judged then.
    """
    count = len(kept[0].channels)
    size, best, first = np.zeros(count), np.zeros(count), np.zeros(count, np.int64)
    sides = {}
    for split in range(1, len(times)):
        sides[split] = _Side.of(kept[:split]), _Side.of(kept[split:])
        own, score = _compared(*sides[split])
        better = score > best
        best[better], size[better], first[better] = score[better], own[better], split
    rows = np.flatnonzero((best > SURE) & (np.abs(size) > WEAKER) & (first < len(times) - 1))
    strays = []
    for row in rows.tolist():
        old, new = (side.stray(row) for side in sides[int(first[row])])
        if new > STRAY * max(old, 1.0):
            strays.append(row)
    for row in strays or rows.tolist():
        split = int(first[row])
        kind = "weaker" if size[row] < 0 else "stronger"
        words = f"{kind} by {abs(np.expm1(size[row])):.0%}"
        for before in range(1, split):
            back = _compared(sides[before][0], sides[split][1])[0][row]
            if abs(back) < min(WEAKER, 0.5 * abs(size[row])):
                kind, words = "recovered", f"back at its first gain, {words}"
        if strays:
            kind, words = "swapped_channels", "feels another place (exchanged channels?)"
        sure = 1.0 - min(0.5, 2.0 * count * float(norm.sf(best[row])))
        yield _change(part, row, kind, words, times[split], sure)


def _rest_changes(part: str, times: Sequence[str], kept: Sequence[KeptPart]) -> Iterator[Change]:
    """Taxels whose baseline or noise is another one from a check-up on, and still is."""
    level = np.array([one.baseline for one in kept])
    level = level - level[0]
    level -= np.median(level, axis=1, keepdims=True)
    split, old, new = _steps(level)
    still = np.minimum(np.abs(level[-1] - old), np.abs(level[-1]))
    for row in np.flatnonzero((np.abs(new - old) > MOVED) & (still > MOVED)).tolist():
        way = "higher" if new[row] > old[row] else "lower"
        text = f"its rest lies {abs(new[row] - old[row]):.0f} counts {way}"
        yield _change(part, row, "moved", text, times[split[row]], 0.95)
    rough = np.array([one.noise for one in kept])
    split, old, new = _steps(rough)
    usual = np.maximum(np.maximum(old, rough[0]), np.median(rough))
    for row in np.flatnonzero(np.minimum(new, rough[-1]) > NOISIER * usual + 0.3).tolist():
        text = f"{new[row] / usual[row]:.1f} times as noisy"
        yield _change(part, row, "noisier", text, times[split[row]], 0.95)


def _steps(course: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """For each of n courses (e, n) the split that two constants fit best, and these (n,)."""
    least = np.full(course.shape[1], np.inf)
    split = np.ones(course.shape[1], np.int64)
    ends = np.zeros((2, course.shape[1]))
    for one in range(1, len(course)):
        before, after = course[:one], course[one:]
        pair = np.array([np.median(before, axis=0), np.median(after, axis=0)])
        off = np.abs(before - pair[0]).sum(axis=0) + np.abs(after - pair[1]).sum(axis=0)
        better = off < least
        least[better], split[better], ends[:, better] = off[better], one, pair[:, better]
    return split, ends[0], ends[1]


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
        own = [one.row for one in changes if one.part == part and one.kind != "recovered"]
        drawn = {"rest [counts]": [one.baseline for one in kept],
                 "noise [counts]": [one.noise for one in kept],
                 "gain beside its neighbours": np.exp(gain)}  # fmt: skip
        for axis, (name, values) in zip(line, drawn.items(), strict=True):
            table = np.asarray(values)
            axis.plot(days, table[:, :MOST_DRAWN], ".-", color="#9fb0bd", lw=0.4, ms=2, alpha=0.6)
            for row in list(dict.fromkeys(own))[:8]:
                label = f"taxel {kept[0].channels[row]}"
                axis.plot(days, table[:, row], ".-", lw=1.6, label=label)
            axis.set_title(f"{part}: {name}", loc="left", fontsize=9)
            axis.tick_params(axis="x", labelrotation=30, labelsize=7)
        if own:
            line[0].legend(frameon=False, fontsize=7)
    return figure


A4 = (8.27, 11.69)  # [inch]
MOST_PARTS, MOST_LINES, WIDE = 3, 26, 96
COLOUR = {"healthy": "#009e73", "faulty": "#d55e00", "undecided": "#e69f00",
          "inconsistent": "#d55e00"}  # fmt: skip


def write_page(
    path: Path, result: CheckupResult, cases: Sequence[Case], robot: Robot, when: str
) -> None:
    """Write the check-up as a page, a PDF by its suffix."""
    ill = {one.part for one in result.faults}
    shown = sorted(cases, key=lambda case: case.part not in ill)[:MOST_PARTS]
    words = [line for one in lines(result) for line in textwrap.wrap(
        one, WIDE, subsequent_indent="      ", drop_whitespace=False)][1:]  # fmt: skip
    if len(words) > MOST_LINES:
        words = [*words[:MOST_LINES], f"and {len(words) - MOST_LINES} more lines: see --json"]
    figure = plain_figure(A4)
    high = 1.0 + 0.16 * len(words)  # of the words [inch]
    share = (A4[1] - high) / max(len(shown), 1)
    text, *maps = figure.subplots(1 + len(shown), 1, height_ratios=[high, *[share] * len(shown)])
    text.set_axis_off()
    text.text(0, 1, result.status.capitalize(), fontsize=22, color=COLOUR[result.status],
              weight="bold", va="top", transform=text.transAxes)  # fmt: skip
    head = f"Check-up of {result.robot}, {when}: {WORDS[result.status]}"
    body = "\n".join([*textwrap.wrap(head, WIDE), "", *words])
    text.annotate(body, (0, 1), (0, -30), xycoords="axes fraction", textcoords="offset points",
                  fontsize=8, va="top", linespacing=1.35)  # fmt: skip
    for axis, case in zip(maps, shown, strict=True):
        channels = case.boards.table.channels
        states = {
            int(row): one.kind.replace("_", " ")
            for one in reversed(result.faults) if one.part == case.part
            for row in np.flatnonzero(np.isin(channels, one.channels))
        }  # fmt: skip
        draw_channels(axis, flat_places(robot, case), states, dict(enumerate(channels.tolist())))
        axis.set_anchor("NW")
        axis.set_title(f"{case.part}, laid flat", loc="left", fontsize=9)
    save_figure(figure, path)


def flat_places(robot: Robot, case: Case) -> FloatArray:
    """(n, 2) of a part's taxels laid flat; without a flat map, from one side."""
    import skinmap

    positions = case.boards.table.positions
    try:
        uv = skinmap.flatten(skinmap.build_surface(robot.skin(case.part))).uv
    except SkinError:
        uv = np.full((len(positions), 2), np.nan)
    known = np.isfinite(uv[:, 0]) if len(uv) == len(positions) else np.zeros(1, bool)
    if not known.all():
        centred = positions - positions.mean(axis=0)
        uv = centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T
    return np.asarray(uv)
