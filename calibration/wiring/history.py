"""Check-ups that were kept: each taxel's baseline, noise and gain over months, and their changes.

A touch is of unknown place and force, so its answers are compared with each other: a smooth surface
is laid through their logarithms, and the distance of a taxel from it is its gain beside its
neighbours. All touches of all check-ups are laid together, so that the gains of the neighbours are
known when a taxel's is judged.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from calibration.wiring.answer_model import THRESHOLD, tangents
from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import DataFormatError, OutputError
from skinmap.io.output import staged_file
from skinmap.report.page import plain_figure, save_figure

if TYPE_CHECKING:
    from calibration.wiring.boards import Boards
    from calibration.wiring.examination import Case, Examination
    from calibration.wiring.findings import CheckupResult

FULL = 250.0  # counts above which an answer is cut off
BESIDE, NEAR = 9e-3, 7e-3  # from a stroke, and from the middle of a poke [m]
FEWEST = {"stroke": 9, "poke": 7}  # answers that a surface is laid through
EXPECTED = 35.0  # counts below which an answer is too small to compare [counts]
ROUNDS, PRIOR = 12, 0.3  # of the joint fit; spread of gains before anything is known [log]
LEAST = 1.2  # touches on each side of a change
SURE, MODEL = 3.6, 0.65  # deviations that a change needs; error that all touches share
WEAKER = 0.15  # least change of a gain [log]
MOVED, NOISIER = 12.0, 3.0  # least change of a baseline [counts], and of a noise (times)
MOST_DRAWN = 400  # taxels of which each has a line of its own


class KeptTouch(msgspec.Struct, frozen=True):
    """A touch of known place: rows that answered, and their answers [counts]."""

    how: str
    path: list[list[float]]
    rows: list[int]
    answers: list[float]


class KeptPart(msgspec.Struct, frozen=True):
    """A part in a check-up; the lists have a number for each row of the taxel table."""

    channels: list[int]
    baseline: list[float]
    noise: list[float]
    touches: list[KeptTouch]


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
            or any(len(t.rows) != len(t.answers) or not t.path or any(len(p) != 3 for p in t.path)
                   or not all(0 <= r < len(part.channels) for r in t.rows) for t in part.touches)
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
        several = [
            one for one in (*before, now)
            if one.robot == now.robot and case.part in one.parts
            and one.parts[case.part].channels == case.boards.table.channels.tolist()
        ]  # fmt: skip
        if len(several) > 1 and case.doctor.status != "inconsistent":
            own, times = [one.parts[case.part] for one in several], [one.time for one in several]
            found, gain = changes_of(case.boards, times, own)
            changes += found
            courses.append((case.part, times, own, gain))
    files = [str(stem.with_suffix(".json"))]
    if courses:
        with staged_file(stem.with_suffix(".pdf")) as stage:
            save_figure(_drawing(courses, changes), stage)
        files.append(str(stem.with_suffix(".pdf")))
    return changes, files


def changes_of(
    boards: Boards, times: Sequence[str], kept: Sequence[KeptPart]
) -> tuple[list[Change], FloatArray]:
    """What changed over check-ups of a part, and the gains (e, n), logarithms."""
    gain, weight, noise = gains_over(boards, [one.touches for one in kept])
    return list(_changes(boards.part, times, kept, gain, weight, noise)), gain


def kept_part(case: Case) -> KeptPart:
    """What is kept of a part: touches where its wiring is as mapped."""
    assert case.rest is not None
    wrong = {c for found in case.doctor.found for c in found.fault.channels(case.boards)}
    channels = case.boards.table.channels.tolist()
    touches = []
    for one in case.doctor.touches if case.doctor.status != "inconsistent" else ():
        if one.path is None:
            continue
        rows = [r for r in np.flatnonzero(one.response > 0.5 * THRESHOLD).tolist()
                if channels[r] not in wrong]  # fmt: skip
        touches.append(KeptTouch(one.how, np.round(one.path, 4).tolist(), rows,
                                 np.round(one.response[rows], 1).tolist()))  # fmt: skip
    return KeptPart(channels, np.round(case.rest.level, 2).tolist(),
                    np.round(case.rest.noise, 3).tolist(), touches)  # fmt: skip


@dataclass(eq=False, slots=True)
class _Laid:
    """A touch laid on the skin: rows, logarithms of their answers, and the terms of a surface."""

    epoch: int
    rows: IntArray
    log: FloatArray
    terms: FloatArray


def _laid(boards: Boards, touch: KeptTouch, epoch: int) -> _Laid | None:
    rows, answers = np.array(touch.rows, np.int64), np.array(touch.answers)
    good = (answers < FULL) & (answers > 0)
    rows, answers, path = rows[good], answers[good], np.array(touch.path)
    places = boards.table.positions[rows]
    if touch.how == "stroke" and len(path) > 1:
        away = np.linalg.norm(places[:, None] - path[None], axis=2)
        nearest = away.argmin(axis=1)
        along = np.gradient(path, axis=0)[nearest]
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        off = places - path[nearest]
        s = nearest / (len(path) - 1) * 2.0 - 1.0
        y = np.einsum("ij,ij->i", np.cross(boards.normals[rows], along), off) / BESIDE
        s = s + np.einsum("ij,ij->i", along, off) / (0.5 * STROKE)
        keep = (np.abs(y) < 1.0) & (np.abs(s) < 1.05) & (away.min(axis=1) < 2 * BESIDE)
        terms = np.column_stack([*(s**k for k in range(6)), y, y**2, s * y, s * y**2])
    else:
        u, v = (tangents(boards, path[0]) @ (places - path[0]).T) / NEAR
        keep = np.hypot(u, v) < 2.0
        terms = np.column_stack([np.ones(len(u)), u, v, u**2 + v**2])
    keep &= answers > THRESHOLD
    if keep.sum() < FEWEST[touch.how]:
        return None
    return _Laid(epoch, rows[keep], np.log(answers[keep]), terms[keep])


STROKE = 0.09  # length of a stroke [m]


def gains_over(
    boards: Boards, epochs: Sequence[Sequence[KeptTouch]]
) -> tuple[FloatArray, FloatArray, float]:
    """Gains of each taxel in each check-up.

    Parameters
    ----------
    boards : Boards
        Of a part with n taxels.
    epochs : sequence of sequences of KeptTouch
        Touches of e check-ups.

    Returns
    -------
    gain : (e, n) float
        Logarithm of the gain beside that of the neighbours; NaN where nothing measured it.
    weight : (e, n) float
        Touches behind it.
    noise : float
        Standard deviation of the gain of one touch.
    """
    found = (_laid(boards, one, k) for k, several in enumerate(epochs) for one in several)
    laid = [one for one in found if one is not None]
    n = len(boards.table)
    own = np.zeros((len(epochs), n))
    total, weight = np.zeros_like(own), np.zeros_like(own)
    residuals: list[FloatArray] = []
    for _ in range(ROUNDS):
        total[:], weight[:], residuals = 0.0, 0.0, []
        for one in laid:
            gap, trust = _beside(one, own[one.epoch, one.rows])
            np.add.at(total[one.epoch], one.rows, trust * (gap + own[one.epoch, one.rows]))
            np.add.at(weight[one.epoch], one.rows, trust)
            residuals.append((gap * np.sqrt(trust))[trust > 0])
        # A taxel is mostly what it was: the mean of all check-ups, and its own where they differ.
        mean = total.sum(axis=0) / (weight.sum(axis=0) + 0.3)
        alone = (total + mean) / (weight + 1.0)
        own[:] = np.where(np.abs(alone - mean) > 0.2, alone, mean)
    noise = 1.4826 * float(np.median(np.abs(np.concatenate(residuals)))) if residuals else np.inf
    gain = np.where(weight > 0.2, total / np.maximum(weight, 1e-9), np.nan)
    return gain, weight, noise


def _beside(one: _Laid, gains: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far each answer lies from a surface through the others, and the trust in that."""
    wanted = one.log - gains
    weight = np.ones(len(wanted))
    for _ in range(4):
        scaled = one.terms * weight[:, None]
        square = scaled.T @ one.terms + 1e-3 * np.eye(one.terms.shape[1])
        inverse = np.linalg.inv(square)
        gap = wanted - one.terms @ (inverse @ (scaled.T @ wanted))
        size = 1.4826 * float(np.median(np.abs(gap))) + 0.02
        weight = 1.0 / np.maximum(1.0, np.abs(gap) / (1.5 * size)) ** 2
    lever = np.clip(weight * np.einsum("ij,jk,ik->i", one.terms, inverse, one.terms), 0.0, 0.95)
    strong = one.log - gap - gains > np.log(EXPECTED) - 0.5
    return gap / (1.0 - lever), np.where(strong & (lever < 0.5), 1.0 - lever, 0.0)


def _changes(
    part: str, times: Sequence[str], kept: Sequence[KeptPart],
    gain: FloatArray, weight: FloatArray, noise: float,
) -> Iterator[Change]:  # fmt: skip
    """Taxels whose gain, baseline or noise is another one from a check-up on."""
    best = np.full(gain.shape[1], 0.0)
    size, first = np.zeros_like(best), np.zeros(len(best), np.int64)
    value = np.nan_to_num(gain)
    there = np.where(np.isnan(gain), 0.0, weight)
    for split in range(1, len(times) - 1):  # two check-ups must show it
        old, new = there[:split].sum(axis=0), there[split:].sum(axis=0)
        both = (old > LEAST) & (new > LEAST)
        before = (there[:split] * value[:split]).sum(axis=0) / np.maximum(old, 1e-9)
        after = (there[split:] * value[split:]).sum(axis=0) / np.maximum(new, 1e-9)
        step = np.where(both, after - before, 0.0)
        spread = noise * np.sqrt(1 / np.maximum(old, LEAST) + 1 / np.maximum(new, LEAST))
        score = np.abs(step) / np.hypot(spread, MODEL * noise)
        better = both & (score > best)
        best[better], size[better], first[better] = score[better], step[better], split
    for row in np.flatnonzero((best > SURE) & (np.abs(size) > WEAKER)).tolist():
        share = abs(np.expm1(size[row]))
        kind = "weaker" if size[row] < 0 else "stronger"
        yield _change(part, row, kind, f"{kind} by {share:.0%}", times[first[row]], 0.99)
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
