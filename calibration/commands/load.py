"""`skinmap calibrate load`: pressures of taxels in bar, from a known load beside the samples."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from calibration.commands.calibration_options import FILE, Outputs, outputs, skin_of, skin_options
from calibration.commands.results import Calibrated, Spread
from skinmap.commands.options import Number, prints
from skinmap.errors import DataFormatError, SkinMismatchError, warn
from skinmap.rows import percent
from skinmap.summary import first_few

if TYPE_CHECKING:
    from calibration.response.load_fit import LoadFit, Pressed
    from skinmap.io.recordings.load_evidence import LoadEvidence

MAX_NAMED = 40  # taxels left out that words name
MOST_UNLOADED = 0.5  # of all taxels: with more that no evidence pressed a calibration is refused
DRAWN = 40  # points of a curve
DRAWN_ROWS = 30_000  # the first of a recording: intervals of all would fill the memory


@dataclass(frozen=True, kw_only=True, slots=True)
class ClockRow:
    """One line between the clock of a reference and that of the skin.

    Attributes
    ----------
    recording
        File of the recording.
    first_row
        Row of the reference from which the line holds.
    offset_rows, slope_percent
        Skin row = reference row + offset + slope x reference row.
    residual_rows
        Median distance of local lags from the lines.
    """

    recording: str
    first_row: int
    offset_rows: float
    slope_percent: float
    residual_rows: float


@dataclass(frozen=True, kw_only=True, slots=True)
class LoadResult(Calibrated):
    """Pressures of the taxels of a skin.

    Attributes
    ----------
    channels, answered
        All, and those whose pressure is known.
    dead, stray
        Channels that never moved, and that did not follow the others: left out of all sums.
    unloaded
        Channels that no evidence pressed: left out as well, though they may be sound.
    model
        Step of the ladder that did best on held-out stretches: `linear`, `cubic`, `hysteresis`.
    mean_s
        Running mean of the counts that did best there [s].
    held_out_bar
        Median error of each step on held-out stretches [bar].
    shared_shape
        Taxels with the shape that all share, scaled to each.
    error_bar
        Error of the taxels on held-out stretches [bar].
    doubt_bar
        Of a session's offset that all taxels share [bar].
    top_bar
        End of the calibrated range [bar].
    top_n
        Highest force of the evidence [N]; null for pressures.
    rest_bar
        Reading of a reference while the skin rests, by recording [bar]; references that read 0 are
        left out.
    uneven
        Standard deviation of a taxel's pressure by uneven contact, as a share: masses and forces
        give the mean over their channels.
    clocks
        A line or more for each recording.
    area_mm2
        Area of a taxel; null where none was given.
    with_temperature
        Taxels whose rest follows the temperature of their module; null where it is not known.
    prints
        Touches with a known print; null without any.
    spread_mm
        Of a pressure through the foam, standard deviation; null without prints.
    print_error
        Median error of the area of a print by the others; null without prints.
    fingerprint
        Of the skin; empty without `--part`.
    """

    channels: int
    answered: int
    dead: list[int]
    stray: list[int]
    unloaded: list[int]
    model: str
    mean_s: float
    held_out_bar: dict[str, float]
    shared_shape: int
    error_bar: Spread
    doubt_bar: float
    top_bar: float
    top_n: float | None
    rest_bar: dict[str, float]
    uneven: float
    clocks: list[ClockRow]
    area_mm2: float | None
    with_temperature: int | None
    prints: int | None
    spread_mm: float | None
    print_error: float | None
    fingerprint: str


@click.command("load")
@click.argument("evidence", nargs=-1, required=True, type=FILE)
@skin_options
@click.option(
    "--area-mm2", type=Number(0.0, 1e4, min_open=True), help="Area of a taxel, for newtons."
)
@outputs("load.npz and the report", required=True)
@prints(LoadResult)
def load(output: Outputs, **given: Any) -> None:
    """Pressures of taxels in bar, with intervals that hold on another day.

    EVIDENCE holds `samples (t, n)` in counts and `times (t,)` [s] beside one reference on its own
    clock: `pressure_bar`, `pressure_kpa` or `pressure_pa (u,)` of a chamber or a bag, `mass_kg`
    (with `footprint (k,)`: channels it lies on), `stand` (kilograms of a person who stands on all),
    `force_n` of a load cell on `channels (k,)`, or `wrench (u, 6)` of a sensor behind the skin, in
    the frame of its link (needs --part). A file of `prints (k,)` [mm2] beside it, with the touch
    of each row in `events (t,)`, teaches areas (needs --part). `reference_times (u,)` may be absent
    where both have the same nominal rate. CSV: a column `time`, one reference, every other column
    a channel. Masses and load cells need .npz, which names their channels.

    \b
    Example:  skinmap calibrate load calibration.npz -o load
    """
    output.of("load", partial(work, **given), _lines, _write, _page)


def work(
    *, evidence: tuple[Path, ...], robot: str, part: str | None, area_mm2: float | None
) -> tuple[LoadResult, LoadFit, list[Pressed]]:
    """Fit the pressures of a skin."""
    from calibration.response.load_fit import fit_load
    from calibration.response.load_references import fit_prints, fit_wrench
    from skinmap.io.recordings.load_evidence import FORCES, PRINTS, WRENCH, check_bar, read_evidence
    from skinmap.touch.load_calibration import REST_FAR, UNEVEN

    held = [read_evidence(path) for path in evidence]
    counts = [one.samples.shape[1] for one in held]
    for path, count in zip(evidence, counts, strict=True):
        if count != counts[0]:
            raise SkinMismatchError(f"{path} has {count} channels, {evidence[0]} {counts[0]}")
    loads = [(one, path) for one, path in zip(held, evidence, strict=True) if one.kind != PRINTS]
    if not loads:
        raise DataFormatError("prints teach areas: a file with a known load is needed", evidence[0])
    pressed = [_pressed(one, path, area_mm2) for one, path in loads]
    skin, marks = skin_of(robot, part, counts[0])
    when = max(path.stat().st_mtime for path in evidence)
    if any(one.reference.ndim == 2 for one in pressed):
        path = next(own for one, own in loads if one.kind == WRENCH)
        if skin is None:
            raise DataFormatError("a wrench needs --part: its sum goes over the mesh", path)
        if len(pressed) > 1:
            raise DataFormatError("a wrench is fitted alone, without other files of loads", path)
        if pressed[0].thermal is not None:
            raise DataFormatError("a wrench is fitted without temperature_channel", path)
        fit = fit_wrench(pressed[0], skin, when=when, fingerprint=marks)
        check_bar(float(fit.calibration.top.max()), loads[0][0].kind, loads[0][1])
    else:
        fit = fit_load(pressed, when=when, area_mm2=area_mm2 or float("nan"), fingerprint=marks)
        if all(one.kind in FORCES for one, _ in loads):
            fit = replace(fit, calibration=replace(fit.calibration, uneven=UNEVEN))
    prints = None
    if printed := [one for one in held if one.kind == PRINTS]:
        if skin is None:
            raise SkinMismatchError(f"{printed[0].name}: prints need --part: areas are of its mesh")
        prints = fit_prints(printed, fit.calibration, skin)
        fit = replace(fit, calibration=replace(fit.calibration, covering=prints.covering))
    found, reasons = fit.calibration, []
    if len(fit.unloaded) > MOST_UNLOADED * counts[0]:
        reasons = [
            f"No load was on {len(fit.unloaded)} of {counts[0]} taxels: press the others too."
        ]
    for one, share in zip(pressed, fit.moved, strict=False):
        if share > REST_FAR:
            words = f"{one.name}: rest moves by {percent(share)} % of its range; the skin warms or"
            warn(f"{words} its foam keeps loads: record it warm, or with temperature_channel")
    result = LoadResult(
        status="low_coverage" if reasons else "ok",
        reasons=reasons,
        channels=counts[0],
        answered=int(found.answered.sum()),
        dead=fit.dead,
        stray=fit.stray,
        unloaded=fit.unloaded,
        model=found.model,
        mean_s=found.mean_s,
        held_out_bar=fit.held_out,
        shared_shape=fit.shared,
        error_bar=Spread.of(found.error[found.answered]),
        doubt_bar=found.doubt,
        top_bar=float(found.top.max()),
        top_n=_top_newtons([one for one, _ in loads]),
        rest_bar={
            one.name: bar for one, bar in zip(pressed, fit.at_rest, strict=False) if bar != 0
        },
        uneven=found.uneven,
        clocks=[
            ClockRow(
                recording=one.name,
                first_row=line.first_row,
                offset_rows=line.offset_rows,
                slope_percent=100 * line.slope,
                residual_rows=line.residual_rows,
            )
            for one, lines in zip(pressed, fit.clocks, strict=True)
            for line in lines
        ],
        area_mm2=area_mm2,
        with_temperature=None if found.warmth is None else int((found.warmth.channel >= 0).sum()),
        prints=None if prints is None else prints.prints,
        spread_mm=None if prints is None else 1e3 * prints.covering.spread,
        print_error=None if prints is None else prints.error,
        fingerprint=marks,
    )
    return result, fit, pressed


def _top_newtons(loads: list[LoadEvidence]) -> float | None:
    """The highest force of some recordings [N]."""
    import numpy as np

    from skinmap.io.recordings.load_evidence import PRESSURES

    found = [one.reference for one in loads if one.kind not in PRESSURES]
    sizes = [
        one if one.ndim == 1 else np.linalg.norm((one - np.median(one, axis=0))[:, :3], axis=1)
        for one in found
    ]
    return max((float(one.max()) for one in sizes), default=None)


def _pressed(one: LoadEvidence, path: Path, area_mm2: float | None) -> Pressed:
    """One file as a pressure on its channels."""
    import numpy as np

    from calibration.response.load_fit import Pressed
    from skinmap.io.recordings.load_evidence import BAR, FORCES, check_bar

    one, _, lost = one.on_even_rows()
    reference, channels = one.on_nominal_rows(), one.channels
    if one.kind in FORCES:
        if channels is None and one.kind != "stand":
            names = "`footprint (k,)`" if one.kind == "mass_kg" else "`channels (k,)`"
            words = "" if path.suffix == ".npz" else "; only an .npz file can hold them"
            words = f"{one.kind} needs {names}: the channels that carry it{words}"
            raise DataFormatError(words, path)
        if area_mm2 is None:
            raise DataFormatError(f"{one.kind} needs --area-mm2, the area of a taxel", path)
        if channels is None:  # a person stands on all of them, unevenly
            channels = np.arange(one.samples.shape[1])
        reference = reference / (area_mm2 * 1e-6 * len(channels)) * BAR
        check_bar(float(reference.max()), one.kind, path)
    timed = one.reference_times is not None
    return Pressed(one.name, one.samples, one.rate, reference, channels, one.thermal, lost, timed)


def _write(fit: LoadFit, _: list[Pressed], folder: Path) -> list[str]:
    from skinmap.touch.load_calibration import FILE as NAME

    (folder / NAME).write_bytes(fit.calibration.to_bytes())
    return [NAME]


def _lines(result: LoadResult) -> Iterator[str]:
    yield (
        f"{result.answered} of {result.channels} taxels, 0 to {result.top_bar:.2f} bar, model "
        f"{result.model}, running mean of {result.mean_s:g} s: error "
        f"{result.error_bar.median:.3f} bar (median, held out)"
    )
    if result.top_n is not None:
        yield f"highest force of the evidence: {result.top_n:.3g} N"
    for name, bar in result.rest_bar.items():
        yield f"{name} reads {bar:+.3g} bar while the skin rests: take its tare off, if it is one"
    if result.uneven:
        yield f"uneven contact: a taxel's share of a force is known to {percent(result.uneven)} %"
    for row in result.clocks:
        yield (
            f"clock of {row.recording}, from row {row.first_row}: {row.offset_rows:+.0f} rows "
            f"{row.slope_percent:+.2f} %, residual {row.residual_rows:.0f} rows"
        )
    if result.with_temperature is not None:
        yield f"rest follows the temperature of the module: {result.with_temperature} taxels"
    if result.prints is not None:
        yield (
            f"areas by {result.prints} prints: error {percent(result.print_error)} % (median, each "
            f"by the others), pressure spreads by {result.spread_mm:.1f} mm"
        )
    yield f"left out, dead: {first_few(result.dead, MAX_NAMED) or 'none'}"
    stray = first_few(result.stray, MAX_NAMED) or "none"
    yield f"left out, do not follow or are saturated: {stray}"
    yield f"left out, no load on them: {first_few(result.unloaded, MAX_NAMED) or 'none'}"


def _page(fit: LoadFit, pressed: list[Pressed], result: LoadResult) -> str:
    from calibration.commands.pages import judged_page

    words = (
        "Pressures that the calibration reads against those of the reference: median of the "
        "taxels, the half of them in the dark band, 90 % intervals of a taxel in the light one."
    )
    pictures = [("Curves", _picture(fit, pressed[0]), words)]
    return judged_page("Loads", result, _lines(result), pictures)


def _picture(fit: LoadFit, one: Pressed) -> bytes:
    """PNG: what taxels read over the reference, with bands; the error of each taxel."""
    import numpy as np

    from skinmap.clock_lines import reference_at
    from skinmap.report.page import picture_bytes, plain_figure

    if one.reference.ndim == 2:  # a wrench: no taxel has a reference of its own
        figure = plain_figure((9.0, 4.4))
        _errors(figure.subplots(), fit)
        return picture_bytes(figure)
    rows = one.samples[:DRAWN_ROWS]
    wanted = reference_at(fit.clocks[0], one.reference, len(rows))
    values, low, high = fit.calibration.pressures(rows, zero="none")
    own = fit.calibration.answered
    edges = np.linspace(np.nanmin(wanted), np.nanmax(wanted), DRAWN + 1)
    middle, bands = [], []
    for start, end in pairwise(edges):
        use = np.flatnonzero((wanted >= start) & (wanted <= end))[::5]
        if len(use) < 3:
            continue
        middle.append((start + end) / 2)
        read = np.nanmedian(values[use][:, own], axis=0)
        ends = [np.nanmedian(np.nanmedian(side[use][:, own], axis=0)) for side in (low, high)]
        bands.append([*np.nanpercentile(read, (25, 50, 75)), *ends])
    lines = np.array(bands).T
    figure = plain_figure((9.0, 4.4))
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    left.fill_between(middle, lines[3], lines[4], color="#00795c", alpha=0.15, lw=0)
    left.fill_between(middle, lines[0], lines[2], color="#00795c", alpha=0.4, lw=0)
    left.plot(middle, lines[1], color="#00795c")
    left.plot(edges[[0, -1]], edges[[0, -1]], color="#9aa5b1", lw=0.8, ls="--")
    left.set_xlabel("reference [bar]")
    left.set_ylabel("read by taxels [bar]")
    _errors(right, fit)
    return picture_bytes(figure)


def _errors(axes: Any, fit: LoadFit) -> None:
    own = fit.calibration.answered.nonzero()[0]
    axes.scatter(own, fit.calibration.error[own], s=9, color="#00795c")
    axes.set_xlabel("channel")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_ylabel("error, held out [bar]")
    axes.set_ylim(bottom=0)
