"""`skinmap evaluate --protocol force`: forces of contacts against those of MuJoCo.

`skinmap evaluate --protocol load MODEL RECORDING...`: pressures beside those of a chamber.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from skinmap.arrays import BoolArray, FloatArray
from skinmap.cli.evaluate.command import Evaluation, Own, Settings, write_predictions
from skinmap.clock_lines import UNEXPLAINED, align, reference_at
from skinmap.commands.options import open_robot
from skinmap.commands.progress import progress
from skinmap.errors import InvalidArrayError
from skinmap.io.recordings.load_evidence import EvenRows, read_evidence
from skinmap.live.response.loads import PartForces
from skinmap.parallel.run import task_rng
from skinmap.physics.pressing import Pressed, import_mujoco
from skinmap.physics.simulation import (
    FULL_PRESSURE,
    Ground,
    draw_people,
    find_place,
    make_ground,
    press_place,
    taxel_loads,
)
from skinmap.physics.variants import FROZEN, find_variant
from skinmap.recognition.protocols.folds import run_repeats
from skinmap.recognition.protocols.results import ForceResult, ForceRow, LoadRow, LoadsResult
from skinmap.report.table import Table
from skinmap.rows import percent
from skinmap.skin.checks import twin_parts
from skinmap.touch.contacts.skin_geometry import ACTIVE, find_contacts
from skinmap.touch.load_calibration import LoadCalibration, Zero
from skinmap.touch.prepared_skin import PreparedSkin
from skinmap.touch.simulation.variety import Sensing, Sensors

BODIES = ("poke", "full_finger", "three_finger", "whole_hand", "ball")
TUNED_ON = ("torso", "left_forearm")  # parts whose touches set how wide the intervals are
RANGES = {"within_range": True, "beyond_range": False}
PEOPLE = 5
NORMAL_90 = 1.645  # standard deviations on either side that hold 90 %
STEPS, EACH, TOP = 9, 20, 1.2  # of the chamber: pressures, samples each, highest, 1 = firm finger
SATURATED = 250.0  # counts


class Judged(NamedTuple):
    """One touch: its true force [N] and ours with its interval; NaN where it was refused."""

    part: str
    body: str
    truth: float
    force: float
    low: float
    high: float
    plain: float  # by the areas of the taxels alone: the control
    away_deg: float
    area_error: float
    area_holds: float
    bounds_hold: float  # of the area by counts alone
    whole: bool  # whether its heaviest moment lies within the calibrated range


def judge_force(settings: Settings) -> ForceResult:
    """Run the protocol.

    Raises
    ------
    SkinError
        MuJoCo is not installed, a part that does not exist, or parts that no body fits.
    """
    import_mujoco()
    loaded, parts = open_robot(settings.robot or "icub", settings.parts)
    twins = twin_parts({part: loaded.skin(part) for part in loaded.parts})
    if not settings.parts:
        tuned = {twins[part] for part in TUNED_ON if part in twins}
        parts = tuple(p for p in parts if twins[p] == p and p not in tuned)
    skins = [PreparedSkin(loaded.skin(part)) for part in parts]
    tasks = [
        {"prepared": skin, "seed": (seed, number)}
        for seed in settings.all_seeds
        for number, skin in enumerate(skins)
    ]
    with settings.working(len(tasks), "force") as shared:
        found = run_repeats(press_part, tasks, count=settings.per_gesture, **shared)
    judged = [one for rows in found for one in rows]
    if not any(np.isfinite(one.force) for one in judged):
        raise InvalidArrayError(f"no touch could be judged on {', '.join(parts)}")
    return ForceResult(
        robot=loaded.name,
        parts=list(parts),
        bodies=list(BODIES),
        per_body=settings.per_gesture,
        physics=FROZEN,
        seeds=settings.all_seeds,
        all=row("all", judged),
        by_body=[row(b, own) for b in BODIES if (own := [j for j in judged if j.body == b])],
        by_part=[row(p, own) for p in parts if (own := [j for j in judged if j.part == p])],
        by_range=[
            row(r, own) for r in RANGES if (own := [j for j in judged if j.whole == RANGES[r]])
        ],
    )


def press_part(prepared: PreparedSkin, seed: tuple[int, ...], *, count: int) -> list[Judged]:
    """Touch a part with each body so often, its taxels calibrated in a chamber before."""
    rng = task_rng(seed)
    skin, variant = prepared.skin, find_variant(FROZEN)
    ground = make_ground(skin, variant, rng=rng)
    sensors = Sensors(skin, Sensing(), rng=rng)
    calibrated = in_chamber(ground, sensors, rng)
    forces = PartForces(prepared, ~sensors.dead)
    people = draw_people(PEOPLE, variant, rng=rng)
    rest, found = np.zeros((EACH, len(skin))), []
    for body in BODIES:
        for number in range(count):
            person = people[number % PEOPLE]
            place = find_place(ground, body, person, rng=rng)
            if place is None:
                break
            pressed = press_place(ground, place, person, rate=sensors.sensing.rate, rng=rng)
            zero = sensors.read(rest, rng=rng).mean(axis=0)
            counts = sensors.read(taxel_loads(ground, pressed), rng=rng).astype(np.float64)
            answer = _judge(pressed, ground.bed.area, counts, zero, calibrated, forces)
            found.append(Judged(skin.part, body, *answer))
    return found


def in_chamber(
    ground: Ground, sensors: Sensors, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Slope (n,) [Pa a count] of each taxel under even pressures, and its doubt (n,) [Pa]."""
    levels = np.repeat(np.linspace(0.0, TOP, STEPS), EACH)
    n = len(ground.bed.skin)
    counts = sensors.read(np.repeat(levels[:, None], n, axis=1), rng=rng).astype(np.float64)
    zero = counts[:EACH].mean(axis=0)
    pressures = levels[:, None] / FULL_PRESSURE * ground.full_scale
    used = counts < SATURATED
    above = np.where(used, counts - zero, 0.0)
    slope = (above * pressures).sum(axis=0) / np.maximum((above**2).sum(axis=0), 1e-9)
    error = np.where(used, pressures - slope * (counts - zero), 0.0)
    return slope, np.sqrt((error**2).sum(axis=0) / np.maximum(used.sum(axis=0), 1))


def _judge(
    pressed: Pressed,
    cell: float,
    counts: FloatArray,
    zero: FloatArray,
    calibrated: tuple[FloatArray, FloatArray],
    forces: PartForces,
) -> tuple[Any, ...]:
    """`Judged` at the heaviest moment within range, which the readings alone choose."""
    slope, spread = calibrated
    inside: BoolArray = np.asarray((counts < SATURATED).all(axis=1))
    sums = np.where(inside, counts.sum(axis=1), -1.0)
    moment = int(sums.argmax())
    above = counts[moment] - zero
    pressure, half = slope * above, NORMAL_90 * spread
    answer = forces.contact(
        np.flatnonzero(above > ACTIVE), pressure, pressure - half, pressure + half, shared=0.5
    )
    whole = bool(inside[int(pressed.forces.argmax())])
    truth, push = float(pressed.forces[moment]), pressed.vectors[moment]
    if answer.refused or truth <= 0.0:
        return truth, *[float("nan")] * 8, whole
    cosine = -answer.normal @ push / max(float(np.linalg.norm(push)), 1e-12)
    away = float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    force, low, high = answer.force
    plain = float(np.where(above > ACTIVE, pressure, 0.0) @ forces.areas)
    covered = cell * np.count_nonzero(pressed.loads[moment])
    area, least, most = answer.area
    found = find_contacts(forces.skin.geometry, np.maximum(above, 0.0))
    bounds = sum(one.area_least for one in found) <= covered <= sum(one.area for one in found)
    judged = abs(area / covered - 1.0), float(least <= covered <= most), float(bounds)
    return truth, force, low, high, plain, away, *judged, whole


def row(name: str, judged: Sequence[Judged]) -> ForceRow:
    """Errors of some touches; null where all were refused."""
    values = np.array([one[2:11] for one in judged])
    values = values[np.isfinite(values[:, 1])]
    truth, force, low, high, plain, away, area, area_holds, bounds = values.T
    error = np.abs(force / truth - 1.0)

    def share(own: FloatArray | BoolArray, middle: Callable[..., Any] = np.median) -> float | None:
        return float(middle(own)) if len(values) else None

    return ForceRow(
        name=name,
        touches=len(judged),
        judged=len(values),
        beyond=float(np.mean([not one.whole for one in judged])),
        force_n_median=share(truth),
        bias=share(force / truth - 1.0),
        error_median=share(error),
        error_p95=share(error, partial(np.quantile, q=0.95)),
        plain_error_median=share(np.abs(plain / truth - 1.0)),
        direction_deg_median=share(away),
        holds=share((low <= truth) & (truth <= high), np.mean),
        area_error_median=share(area),
        area_holds=share(area_holds, np.mean),
        bounds_hold=share(bounds, np.mean),
    )


def force_lines(result: ForceResult) -> Iterator[str | Table]:
    """The tables of a result."""
    yield (
        f"{result.robot}, {', '.join(result.parts)}: total normal force of touches pressed by "
        f"MuJoCo (physics {result.physics!r}), taxels calibrated by even pressures; in %"
    )
    yield Table.of(
        ForceRow,
        [*result.by_body, *result.by_part, *result.by_range, result.all],
        "name= touches judged beyond:%=beyond_range force_n_median:.1f=median_[N] bias:% "
        "error_median:%=error,_median error_p95:%=95_% plain_error_median:%=plain_areas "
        "direction_deg_median:.1f=direction_[deg] holds:%=inside_the_interval "
        "area_error_median:%=error_of_area area_holds:%=area_inside "
        "bounds_hold:%=least_to_most",
    )
    yield "each touch is judged at its heaviest moment within the calibrated range"
    yield "beyond_range: judged in passing; no taxel feels the part that MuJoCo's damper bears"
    yield "plain areas: the control, median error of pressures times the areas of active taxels"


CALENDAR = 1e9  # times above it are seconds since 1970
ROWS = 4000  # judged at once


class ZeroSetting(Own):
    """Where the zero of a recording comes from."""

    zero: Zero = "auto"


def judge_load(settings: Settings) -> LoadsResult:
    """Run the protocol.

    Raises
    ------
    SkinError
        A file that is missing, damaged, of another number of taxels or without samples.
    """
    model, *recordings = settings.recordings
    calibration = LoadCalibration.read(model)
    zero: Zero = settings.own.zero
    rows, written = [], []
    with progress(len(recordings), "load") as advance:
        for path in recordings:
            one = read_evidence(path, needed=False)
            even = one.on_even_rows()
            found = calibration.pressures(even.evidence.samples, even.evidence.times, zero=zero)
            if even.evidence is not one:  # one row for each sample
                found = found[0][even.rows], found[1][even.rows], found[2][even.rows]
            rows.append(_load_row(calibration, even, found, zero))
            if settings.predictions is not None:
                written.append((one.times, *found))
            advance(path.name)
    if settings.predictions is not None:
        names = ("times", "pressure_bar", "low", "high")
        arrays = dict(zip(names, map(np.concatenate, zip(*written, strict=True)), strict=True))
        arrays["recording"] = np.repeat(np.arange(len(written)), [len(one[0]) for one in written])
        write_predictions(settings.predictions, arrays)
    return LoadsResult(
        robot=f"skin of {len(calibration)} taxels",
        model=calibration.model,
        taxels=len(calibration),
        calibrated=int(calibration.answered.sum()),
        rows=rows,
    )


def _load_row(
    calibration: LoadCalibration,
    even: EvenRows,
    found: tuple[FloatArray, FloatArray, FloatArray],
    zero: Zero,
) -> LoadRow:
    (values, low, high), one = found, even.evidence
    answered = np.isfinite(values)
    zeroed = calibration.session(calibration.cooled(one.samples), one.rate, zero=zero).zeroed
    start = float(one.times[0])
    age = 0.0 if zeroed else (start - calibration.zeroed if start > CALENDAR else None)
    width = float(np.nanmean(high - low)) if answered.any() else None
    rms, holds, unexplained, reason = _beside(even, found)
    return LoadRow(
        recording=one.name,
        rms_bar=rms,
        holds=holds,
        width_bar=width,
        refused=float(1.0 - answered.mean()),
        answered=int(answered.any(axis=0).sum()),
        zeroed=zeroed,
        zero_age_seconds=age,
        unexplained=unexplained,
        reason=reason,
    )


def _beside(
    even: EvenRows, found: tuple[FloatArray, FloatArray, FloatArray]
) -> tuple[float | None, float | None, float | None, str]:
    """Error, share of intervals that hold, what alignment leaves open, and why there are none."""
    one = even.evidence
    if not one.kind:
        return None, None, None, ""
    reference = one.on_nominal_rows()
    try:
        lines = align(one.samples, reference, rate=one.rate)
    except InvalidArrayError as error:
        return None, None, None, str(error)
    left = lines[0].unexplained
    if left > UNEXPLAINED:
        words = f"at the best lag {percent(left)} % of its reference are not explained"
        return None, None, left, f"{words} by the samples"
    wanted = reference_at(lines, reference, len(one.samples))[even.rows]
    squares, counts, inside = 0.0, 0, 0
    for start in range(0, len(wanted), ROWS):
        values, low, high = (each[start : start + ROWS] for each in found)
        true = wanted[start : start + ROWS, None]
        good = np.isfinite(values) & np.isfinite(true)
        squares = squares + np.where(good, (values - true) ** 2, 0.0).sum(axis=0)
        counts = counts + good.sum(axis=0)
        load = np.maximum(true, 0.0)  # a reference's noise at rest is no load below 0
        inside += int((good & (low <= load) & (load <= high)).sum())
    own = np.asarray(counts) > 0
    if not own.any():
        return None, None, left, "no taxel answers beside its reference"
    rms = np.sqrt(np.asarray(squares)[own] / np.asarray(counts)[own])
    return float(rms.mean()), inside / int(np.sum(counts)), left, ""


def loads_lines(result: LoadsResult) -> Iterator[str | Table]:
    """The tables of a result."""
    yield (
        f"{result.robot}, {result.calibrated} of them calibrated (model {result.model}); answers "
        "come from the samples and the calibration alone"
    )
    yield Table.of(
        LoadRow,
        result.rows,
        "recording rms_bar:.3f=error_[bar] holds:%=inside_90_%_[%] width_bar:.3f=width_[bar] "
        "refused:%=refused_[%] answered=taxels_that_answer zero=zero",
    )
    for row in result.rows:
        if row.reason:
            yield f"{row.recording}: not judged: {row.reason}"


EVALUATIONS = {
    "force": Evaluation(judge_force, force_lines),
    "load": Evaluation(judge_load, loads_lines, ZeroSetting),
}
