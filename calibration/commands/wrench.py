"""`skinmap calibrate wrench`: the mount of a patch, by the lines of forces that were felt."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from calibration.commands.calibration_options import FILE, Outputs, outputs
from calibration.commands.results import MM, Calibrated, Grade, Matrix, Spread
from skinmap.commands.options import prints, units_option
from skinmap.errors import InvalidArrayError

if TYPE_CHECKING:
    from calibration.files.mount_files import WrenchTouches
    from skinmap.arrays import FloatArray


@dataclass(frozen=True, kw_only=True, slots=True)
class WrenchResult(Calibrated):
    """The mount of a patch, by the lines of forces.

    Attributes
    ----------
    touches
        Total number of touches.
    rms_mm
        Distance of points from their lines, root mean square.
    cross_validation_mm
        The same of touches that the fit never saw; null for fewer than 10 touches.
    predicted_sd_mm
        Predicted error of the taxels.
    weakest
        Least certain motion of the patch, in words.
    mount
        Pose of the patch, T_link_patch [m].
    """

    touches: int
    rms_mm: float
    cross_validation_mm: float | None
    predicted_sd_mm: Spread
    weakest: str
    mount: Matrix


@dataclass(frozen=True, eq=False, slots=True)
class PlacedPatch:
    """A fitted mount, with taxels in the frame of the link; what was touched, where none are known.

    Attributes
    ----------
    mount : (4, 4) float
        T_link_patch.
    places : (n, 3) float
        [m].
    covariance : (n, 3, 3) float
        Of the places [m2].
    taxels : bool
        Whether the places are taxels.
    """

    mount: FloatArray
    places: FloatArray
    covariance: FloatArray
    taxels: bool


@click.command("wrench")
@click.argument("touches", type=FILE)
@units_option("the file; moments are newton times this unit")
@outputs("the mount, taxels and the report")
@prints(WrenchResult)
def wrench(touches: Path, units: str, output: Outputs) -> None:
    """The mount of a rigid patch from the lines of the forces that a force/torque sensor felt.

    TOUCHES is an .npz file with `points (m, 3)` (middle of the active taxels, in the frame of the
    patch), `frames (m, 4, 4)` (link in the sensor's frame), `forces (m, 3)` [N], `moments (m, 3)`
    [N m], and perhaps `taxels (n, 3)` of the patch. Without `taxels` no table is written.

    \b
    Example:  skinmap calibrate wrench touches.npz -o out
    """
    from calibration.files.mount_files import read_wrenches
    from skinmap.io.text import UNITS

    name = touches.stem
    output.of(
        "wrenches", lambda: work(read_wrenches(touches, UNITS[units])), _lines,
        partial(_write, name), partial(_page, name),
    )  # fmt: skip


def work(touches: WrenchTouches) -> tuple[WrenchResult, PlacedPatch]:
    """Fit a mount to lines of force, and judge it."""
    import numpy as np

    from calibration.mount.rigid_mount import (
        FAR,
        POINT_SIGMA,
        Lines,
        fit_lines,
        held_out_error,
        point_covariance,
        wrench_doubts,
    )
    from calibration.patch.patch_status import weak_direction
    from skinmap.geometry.proximity import median_spacing
    from skinmap.geometry.rigid import transform_points

    lines = Lines.of(touches.points, touches.frames, touches.forces, touches.moments)
    fit, held_out = fit_lines(lines), held_out_error(lines, np.random.default_rng(0))
    skin = touches.points if touches.taxels is None else touches.taxels
    known = skin[np.isfinite(skin).all(axis=1)]
    if len(known) < 3 or np.ptp(known, axis=0).max() > FAR:
        words = f"{len(known)} taxels have a place: 3 or more are needed, within {FAR:g} m,"
        raise InvalidArrayError(f"{words} in the unit of the points")
    places = transform_points(fit.mount, skin)
    covariance = point_covariance(fit.mount, skin, fit.covariance)
    sd = np.sqrt(np.einsum("nii->n", covariance))
    half = POINT_SIGMA if touches.taxels is None else median_spacing(known) / 2
    reasons = list(wrench_doubts(lines, known, 2.0 * np.median(sd)))
    status: Grade = "ambiguous" if reasons else "ok"
    if np.median(sd) > half:
        status = "unobservable"
        _, vectors = np.linalg.eigh(covariance.mean(axis=0))
        along = ", ".join(f"{value:.2f}" for value in vectors[:, -1])
        reasons.append(
            f"taxels are known to {MM * np.median(sd):.1f} mm only, half a pitch is "
            f"{MM * half:.1f} mm; least along ({along}) of the link: press from other sides"
        )
    result = WrenchResult(
        status=status,
        reasons=reasons,
        touches=len(touches.points),
        rms_mm=MM * fit.rms,
        cross_validation_mm=None if held_out is None else MM * held_out,
        predicted_sd_mm=Spread.of(MM * sd),
        weakest=weak_direction(places, covariance),
        mount=fit.mount.tolist(),
    )
    return result, PlacedPatch(fit.mount, places, covariance, touches.taxels is not None)


def _write(name: str, placed: PlacedPatch, folder: Path) -> list[str]:
    import numpy as np

    from calibration.files.mount_files import write_mounts

    taxels = np.arange(len(placed.places)), placed.places, placed.covariance
    tables = {"taxels": taxels} if placed.taxels else {}
    return write_mounts({"mounts": {name: placed.mount}}, tables, folder)


def _page(name: str, placed: PlacedPatch, result: WrenchResult) -> str:
    import numpy as np

    from calibration.commands.pages import PLACED, judged_page, places_picture

    errors = np.sqrt(np.einsum("nii->n", placed.covariance))
    pictures = [("On the link", places_picture(placed.places, errors), PLACED)]
    return judged_page(f"Wrenches: {name}", result, _lines(result), pictures)


def _lines(result: WrenchResult) -> Iterator[str]:
    sd = result.predicted_sd_mm
    yield f"{result.touches} touches, {result.rms_mm:.2f} mm rms from their lines"
    yield f"predicted error: median {sd.median:.2f} mm, worst {sd.max:.2f} mm"
    yield f"most easily the patch {result.weakest}"
