"""`skinmap calibrate selftouch`: mounts of patches, by a robot that touches itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from calibration.commands.calibration_options import Outputs, outputs
from calibration.commands.results import MM, Calibrated, Matrix, Probe, grade
from skinmap.commands.options import open_robot, prints

if TYPE_CHECKING:
    from calibration.files.self_touch_files import SelfTouchData
    from calibration.mount.skin_contacts import SelfTouchFit


@dataclass(frozen=True, kw_only=True, slots=True)
class TouchDistances:
    """Root mean square distances between the middles of the active taxels of both sides.

    Attributes
    ----------
    before
        Distances before the calibration.
    after
        Distances after the calibration.
    held_out
        Of touches that the fit never saw.
    """

    before: float
    after: float
    held_out: float


@dataclass(frozen=True, kw_only=True, slots=True)
class SelfTouchResult(Calibrated):
    """Mounts of patches, by a robot that touches itself.

    Attributes
    ----------
    robot, base
        The robot and its root link; null without a robot.
    calibrated
        Chains whose mount was found.
    events
        Total number of touches.
    rms_mm
        Root mean square distance of the touching places.
    split_shift_mm
        Of taxels between fits to two halves.
    predicted_sd_mm
        Median predicted error of the taxels, by chain.
    dropped
        Recordings that were left out.
    inconsistent
        Recordings that contradict the others.
    medians_mm
        Median distance of what touched, by recording.
    mounts
        T_link_patch [m], by chain.
    probes
        Probes by their names.
    joint_offsets_deg
        By joint; by column without a robot.
    notes
        Recordings left out, and unobservable quantities.
    touched
        Share of the taxels of each patch that were touched.
    weakest
        Least certain motion of each patch, in words.
    next
        Channels to touch next, by chain.
    """

    robot: str | None
    base: str | None
    calibrated: list[str]
    events: int
    rms_mm: TouchDistances
    split_shift_mm: float
    predicted_sd_mm: dict[str, float]
    dropped: list[str]
    inconsistent: list[str]
    medians_mm: dict[str, float]
    mounts: dict[str, Matrix]
    probes: dict[str, Probe]
    joint_offsets_deg: dict[str, float]
    notes: list[str]
    touched: dict[str, float]
    weakest: dict[str, str]
    next: dict[str, list[int]]


@click.command("selftouch")
@click.argument(
    "recordings", nargs=-1, required=True, type=click.Path(path_type=Path),
    metavar="RECORDING...",
)  # fmt: skip
@click.option(
    "--robot",
    metavar="ROBOT",
    help="Robot that touched itself; without it, its parts are read from beside the recordings.",
)
@click.option(
    "--calibrate", "names", metavar="PART", multiple=True,
    help="Part whose mount is unknown; may be repeated. All that were touched by default.",
)  # fmt: skip
@outputs("mounts, taxels and the report")
@prints(SelfTouchResult)
def selftouch(
    recordings: tuple[Path, ...], robot: str | None, names: tuple[str, ...], output: Outputs
) -> None:
    """Mounts of skin patches from a robot that touches itself: RECORDING files, or a folder.

    Fingertips without taxels are named in probes.toml beside the recordings (docs/mounts.md).

    Writes mounts.json, a table of taxels (in the frame of their link, with covariances) for each
    part, and report.html. Where the status is not ok, only refused.html is written and the exit
    code is 3, unless --accept. A recording that contradicts the others is left out.

    \b
    Example:  skinmap calibrate selftouch touches.mcap --robot icub -o out
    """
    data = _load(recordings, robot)
    output.of(
        "self-touch", partial(work, data, names), _lines,
        partial(_write, data), partial(_page, data),
    )  # fmt: skip


def _load(recordings: Sequence[Path], robot: str | None) -> SelfTouchData:
    if robot is None:
        from calibration.files.self_touch_files import load_part_touches

        return load_part_touches(recordings)
    from calibration.files.robot_touches import load_robot_touches

    loaded, _ = open_robot(robot, ())
    return load_robot_touches(recordings, loaded)


def work(data: SelfTouchData, names: Sequence[str] = ()) -> tuple[SelfTouchResult, SelfTouchFit]:
    """Fit mounts to recordings of self-touch, and judge them.

    Unknown are the mounts of the chains of some `names`, by default of all with taxels, and zeros
    of joints, by default where the robot is known.
    """
    import numpy as np

    from calibration.commands.self_touch_words import (
        judge,
        next_taxels,
        notes_of,
        placed,
        predicted,
        probe_words,
        touched,
    )
    from calibration.mount.skin_contacts import self_touch
    from calibration.patch.patch_status import weak_direction

    skins = tuple(name for name, one in data.chains.items() if not one.is_probe)
    asked = tuple(_chain(data, name) for name in names)
    fit = self_touch(
        data.recordings,
        data.chains,
        calibrate=asked or skins,
        joint_offsets=bool(data.robot),
        rng=np.random.default_rng(0),
    )
    found = judge(data, fit, asked)
    result = SelfTouchResult(
        status=grade(found[0][0]) if found else "ok",
        reasons=[reason for _, reason in found],
        robot=data.robot or None,
        base=data.base or None,
        calibrated=list(fit.mounts),
        events=sum(map(len, data.recordings)),
        rms_mm=TouchDistances(
            before=MM * fit.rms_before, after=MM * fit.rms_after, held_out=MM * fit.held_out
        ),
        split_shift_mm=MM * fit.split_shift,
        predicted_sd_mm={
            name: MM * float(np.median(predicted(data.chains[name], fit))) for name in fit.mounts
        },
        dropped=list(fit.dropped),
        inconsistent=list(fit.inconsistent),
        medians_mm={name: MM * value for name, value in fit.medians.items()},
        mounts={name: mount.tolist() for name, mount in fit.mounts.items()},
        probes=probe_words(data, fit),
        joint_offsets_deg={
            name: float(np.rad2deg(value)) for name, value in _offsets(data, fit).items()
        },
        notes=list(notes_of(data, fit, asked)),
        touched={name: float(touched(data, fit, name).mean()) for name in fit.mounts},
        weakest={name: weak_direction(*placed(data.chains[name], fit)[1:]) for name in fit.mounts},
        next=next_taxels(data, fit),
    )
    return result, fit


def _chain(data: SelfTouchData, name: str) -> str:
    """A chain by its name, or by that of the link that only it is on."""
    on_link = [chain for chain, link in data.links.items() if link == name]
    return on_link[0] if name not in data.chains and len(on_link) == 1 else name


def _offsets(data: SelfTouchData, fit: SelfTouchFit) -> dict[str, float]:
    """Zeros of joints [rad] by joint, without a robot by column."""
    return {
        data.joints[joint] if data.robot else str(joint): value
        for joint, value in fit.joint_offsets.items()
    }


def _write(data: SelfTouchData, fit: SelfTouchFit, folder: Path) -> list[str]:
    from calibration.commands.self_touch_words import placed
    from calibration.files.mount_files import write_mounts

    found = {"mounts": fit.mounts, "tips": fit.tips, "joint_offsets": _offsets(data, fit)}
    tables = {f"taxels_{name}": placed(data.chains[name], fit) for name in fit.mounts}
    return write_mounts(found, tables, folder)


def _page(data: SelfTouchData, fit: SelfTouchFit, result: SelfTouchResult) -> str:
    from calibration.commands.pages import PLACED, judged_page, places_picture
    from calibration.commands.self_touch_words import placed, predicted

    chains = {name: data.chains[name] for name in fit.mounts}
    pictures = [
        (f"{name} on its link", places_picture(placed(one, fit)[1], predicted(one, fit)), PLACED)
        for name, one in chains.items()
    ]
    title = f"Self-touch: {', '.join(fit.mounts)}"
    return judged_page(title, result, _lines(result), pictures)


def _lines(result: SelfTouchResult) -> Iterator[str]:
    rms = result.rms_mm
    yield (
        f"{', '.join(result.calibrated)}: {rms.before:.2f} -> {rms.after:.2f} mm rms, "
        f"held out {rms.held_out:.2f} mm"
    )
    yield f"taxels move by {result.split_shift_mm:.2f} mm between fits to two halves"
    for name, sd in result.predicted_sd_mm.items():
        yield f"{name}: {result.touched[name]:.0%} of the taxels touched, error {sd:.2f} mm"
        yield f"{name}: weakest direction: the patch {result.weakest[name]}"
        yield f"{name}: touch next: taxels {', '.join(map(str, result.next[name]))}"
    yield f"left out: {', '.join(result.dropped) or 'nothing'}"
    yield from (f"note: {note}" for note in result.notes)
