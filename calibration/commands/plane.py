"""`skinmap calibrate plane`: mounts of patches, by presses on a table in many poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from calibration.commands.calibration_options import FILE, Outputs, outputs
from calibration.commands.results import MM, Calibrated, Matrix, Spread, grade
from skinmap.commands.options import open_robot, part_option, prints, robot_option
from skinmap.errors import InvalidArrayError

PROPOSED = 3  # poses for the next presses

if TYPE_CHECKING:
    from calibration.files.mount_files import PlaneEvidence
    from calibration.plane.fit import PlaneFit
    from calibration.plane.model import Plane
    from skinmap.skin.robot import Robot


@dataclass(frozen=True, kw_only=True, slots=True)
class Surface:
    """A flat surface, in the root link.

    Attributes
    ----------
    point_mm
        Any point of it.
    normal
        Unit, towards the robot.
    """

    point_mm: list[float]
    normal: list[float]


@dataclass(frozen=True, kw_only=True, slots=True)
class NextPress:
    """A pose to press in.

    Attributes
    ----------
    surface
        Number of the surface, from 0.
    joints_deg
        Of joints that turn.
    slides_mm
        Of joints that slide.
    expected_sd_mm
        Error of the taxels once it and those before it are done, root mean square.
    """

    surface: int
    joints_deg: dict[str, float]
    slides_mm: dict[str, float]
    expected_sd_mm: float


@dataclass(frozen=True, kw_only=True, slots=True)
class PlaneResult(Calibrated):
    """Mounts of patches, by presses on a table.

    Attributes
    ----------
    robot
        Name of the robot.
    calibrated
        Names of the calibrated parts.
    contacts
        Number of separate presses.
    predicted_sd_mm
        Predicted error of the taxels.
    touched
        Share of the taxels that felt a press, by part.
    mounts
        T_link_patch [m], by part.
    planes
        Planes of the pressed surfaces.
    joint_offsets_deg
        Zero positions, by joint.
    joint_sd_deg
        Their errors, by joint.
    depth_spread_mm
        Of the presses (sd).
    module_spread_mm
        Shift of a module along each axis (sd).
    widening
        Factor by which the covariances were widened.
    inconsistent
        Contacts that contradict the others, from 0.
    dead, stuck
        Channels left out, by part.
    assumed
        Quantities that the presses leave open and a prior decided, in words.
    weakest
        Least certain motion of each part, in words.
    next
        Poses to press in, the best first.
    """

    robot: str
    calibrated: list[str]
    contacts: int
    predicted_sd_mm: Spread
    touched: dict[str, float]
    mounts: dict[str, Matrix]
    planes: list[Surface]
    joint_offsets_deg: dict[str, float]
    joint_sd_deg: dict[str, float]
    depth_spread_mm: float
    module_spread_mm: float
    widening: float
    inconsistent: list[int]
    dead: dict[str, list[int]]
    stuck: dict[str, list[int]]
    assumed: list[str]
    weakest: dict[str, str]
    next: list[NextPress]


@click.command("plane")
@click.argument("evidence", nargs=-1, required=True, type=FILE, metavar="EVIDENCE...")
@robot_option
@part_option
@click.option(
    "--plane", "planes", multiple=True, metavar="X,Y,Z,NX,NY,NZ",
    help="The surface, where it is known: a point of it [m] and its normal, in the robot's root "
    "link. Repeat it for surfaces 1, 2, ...  Unknown by default.",
)  # fmt: skip
@outputs("mounts, taxels and the report")
@prints(PlaneResult)
def plane(robot: str | None, parts: tuple[str, ...], output: Outputs, **how: Any) -> None:
    """Mounts of skin patches that a robot pressed on a flat surface in many poses.

    EVIDENCE is an .npz file with `joints` (names), `angles (m, j)` [rad] and, of each part,
    `active_PART (m, channels)`, or `ids_PART` with `ptr_PART (m + 1,)`: press i activated the
    channels `ids[ptr[i]:ptr[i + 1]]`; perhaps `surface (m,)` where several were pressed. Or a
    recording (.mcap) that holds joint angles. Where taxels are assumed to be, the robot's manifest
    says.

    Writes mounts.json, a table of taxels (in the frame of their link, with covariances) for each
    part, and report.html. Where the status is not ok, only refused.html is written and the exit
    code is 3, unless --accept. Proposed poses keep the arm off the surface; whether the robot hits
    itself or anything else on the way is not checked.

    \b
    Example:  skinmap calibrate plane presses.npz --robot icub --part right_forearm -o out
    """
    loaded, _ = open_robot(robot, parts)
    output.of(
        "presses", partial(work, loaded, parts, **how), _lines, partial(_write, loaded), _page
    )


def read_planes(words: Sequence[str]) -> list[Plane] | None:
    """Planes from `x,y,z,nx,ny,nz`; None where there are no words.

    Raises
    ------
    InvalidArrayError
        Not six finite numbers, or a normal without length.
    """
    import numpy as np

    from calibration.plane.model import Plane

    planes = []
    for text in words:
        try:
            numbers = np.array([float(word) for word in text.split(",")])
        except ValueError:
            numbers = np.zeros(0)
        if len(numbers) != 6 or not np.isfinite(numbers).all():
            raise InvalidArrayError(
                f"--plane {text!r} must be six numbers x,y,z,nx,ny,nz: a point [m] and the normal"
            )
        planes.append(Plane(numbers[:3], numbers[3:]))
    return planes or None


def work(
    robot: Robot, parts: Sequence[str], *, evidence: Sequence[Path], planes: Sequence[str]
) -> tuple[PlaneResult, PlaneEvidence, PlaneFit]:
    """Fit mounts to presses, and propose the next ones."""
    import numpy as np

    from calibration.files.mount_files import read_plane_evidence
    from calibration.plane.fit import fit_plane
    from calibration.plane.poses import part_chains

    known = read_planes(planes)
    presses = read_plane_evidence(evidence, robot, parts)
    pressed, joints = tuple(presses.contacts.active), presses.joints
    fit = fit_plane(
        presses.contacts,
        list(part_chains(robot, pressed, joints).values()),
        modules={part: robot.skin(part).modules for part in pressed},
        planes=known,
        joint_names=joints,
    )
    turning = [k for k in fit.joint_offsets if joints[k] not in robot.body.sliding_joints]
    channels = {part: robot.skin(part).channels for part in pressed}
    result = PlaneResult(
        status=grade(fit.status),
        reasons=list(fit.reasons),
        robot=robot.name,
        calibrated=list(pressed),
        contacts=len(presses.contacts),
        predicted_sd_mm=Spread.of(MM * np.concatenate([*map(fit.predicted_sd, pressed)])),
        touched={part: float((fit.touched[part] > 0).mean()) for part in pressed},
        mounts={part: mount.tolist() for part, mount in fit.mounts.items()},
        planes=[
            Surface(point_mm=(MM * one.point).tolist(), normal=one.normal.tolist())
            for one in fit.planes
        ],
        joint_offsets_deg={joints[k]: float(np.rad2deg(fit.joint_offsets[k])) for k in turning},
        joint_sd_deg={joints[k]: float(np.rad2deg(fit.joint_sds[k])) for k in turning},
        depth_spread_mm=MM * fit.depth_spread,
        module_spread_mm=MM * fit.shift_spread,
        widening=fit.widening,
        inconsistent=list(fit.inconsistent),
        dead={part: channels[part][list(fit.dead[part])].tolist() for part in pressed},
        stuck={part: channels[part][list(fit.stuck[part])].tolist() for part in pressed},
        assumed=[*fit.assumed, *_still(robot, presses)],
        weakest=dict(fit.weakest),
        next=_proposed(robot, presses, fit),
    )
    return result, presses, fit


def _still(robot: Robot, evidence: PlaneEvidence) -> list[str]:
    """Words on joints without angles."""
    from calibration.plane.poses import stood_still

    joints = (stood_still(robot, part, evidence.joints) for part in evidence.contacts.active)
    still = ", ".join(dict.fromkeys(chain.from_iterable(joints)))
    words = "have no angles: they are taken to have stood still, and planes are given as if at zero"
    return [f"{still} {words}"] if still else []


def _proposed(robot: Robot, presses: PlaneEvidence, fit: PlaneFit) -> list[NextPress]:
    import numpy as np

    from calibration.plane.poses import candidates, pressing

    contacts, joints = presses.contacts, presses.joints
    setup = pressing(robot, tuple(contacts.active), joints, contacts)
    some = candidates(setup, contacts, fit.mounts, fit.planes, np.random.default_rng(0))
    if len(some) == 0:
        return []
    chosen = fit.next_contacts(some, PROPOSED)
    sliding = robot.body.sliding_joints
    found = []
    for row, sd in zip(chosen.rows.tolist(), chosen.sd.tolist(), strict=True):
        pose = dict(zip(joints, some.angles[row].tolist(), strict=True))
        turns = {joint: float(np.rad2deg(v)) for joint, v in pose.items() if joint not in sliding}
        slides = {joint: MM * v for joint, v in pose.items() if joint in sliding}
        surface = int(some.surface[row])
        found.append(
            NextPress(surface=surface, joints_deg=turns, slides_mm=slides, expected_sd_mm=MM * sd)
        )
    return found


def _write(robot: Robot, evidence: PlaneEvidence, fit: PlaneFit, folder: Path) -> list[str]:
    from calibration.files.mount_files import write_mounts

    mounts = {
        "mounts": fit.mounts,
        "covariances": fit.covariances,
        "joint_offsets": {evidence.joints[k]: value for k, value in fit.joint_offsets.items()},
        "planes": [
            {"point": one.point.tolist(), "normal": one.normal.tolist()} for one in fit.planes
        ],
    }
    tables = {
        f"taxels_{part}": (robot.skin(part).channels, places, fit.place_covariances[part])
        for part, places in fit.places.items()
    }
    return write_mounts(mounts, tables, folder)


def _page(evidence: PlaneEvidence, fit: PlaneFit, result: PlaneResult) -> str:
    from calibration.commands.pages import PLACED, judged_page, places_picture

    pictures = [
        (f"{part} on its link", places_picture(fit.places[part], fit.predicted_sd(part)), PLACED)
        for part in evidence.contacts.active
    ]
    title = f"Presses on a flat surface: {', '.join(result.calibrated)}"
    return judged_page(title, result, _lines(result), pictures)


def _lines(result: PlaneResult) -> Iterator[str]:
    sd = result.predicted_sd_mm
    yield f"{', '.join(result.calibrated)}: {result.contacts} contacts"
    yield (
        f"predicted error: median {sd.median:.2f} mm, 95 % below {sd.p95:.2f} mm, "
        f"worst {sd.max:.2f} mm"
    )
    for part, share in result.touched.items():
        yield f"{part}: {100 * share:.0f} % of the taxels felt a press; {result.weakest[part]}"
        for kind, channels in (("dead", result.dead[part]), ("stuck", result.stuck[part])):
            if channels:
                yield f"{part}: {kind} channels, left out: {', '.join(map(str, channels))}"
    yield f"contradicting contacts: {', '.join(map(str, result.inconsistent)) or 'none'}"
    yield from (f"assumed: {words}" for words in result.assumed)
    for number, one in enumerate(result.next, start=1):
        pose = [f"{joint} {value:.1f} deg" for joint, value in one.joints_deg.items()]
        pose += [f"{joint} {value:.1f} mm" for joint, value in one.slides_mm.items()]
        yield f"next {number}: {', '.join(pose)} -> {one.expected_sd_mm:.2f} mm expected (rms)"
