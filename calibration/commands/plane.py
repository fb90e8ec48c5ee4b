"""`skinmap calibrate plane`: presses on a table, in many poses."""

from __future__ import annotations

from pathlib import Path

import click

from calibration.commands.mount_jobs import finish
from calibration.commands.options import FILE, accept_option, format_option, out_option
from skinmap.commands.options import json_option, part_option, robot_option, seed_option
from skinmap.commands.profiles import profile_option
from skinmap.commands.progress import progress


@click.command("plane")
@click.argument("evidence", nargs=-1, required=True, type=FILE, metavar="EVIDENCE...")
@robot_option
@part_option
@click.option(
    "--plane", "planes", multiple=True, metavar="X,Y,Z,NX,NY,NZ",
    help="The surface, where it is known: a point of it [m] and its normal, in the robot's root "
    "link. Repeat it for surfaces 1, 2, ...  Unknown by default.",
)  # fmt: skip
@click.option(
    "--joint-sigma-deg", type=click.FloatRange(min=0, min_open=True), default=0.5,
    show_default=True, help="What zero positions of joints may be off by (sd).",
)  # fmt: skip
@click.option(
    "--threshold", type=click.FloatRange(min=0, min_open=True), default=8.0, show_default=True,
    help="Of recordings: counts above rest from which a taxel is active.",
)  # fmt: skip
@click.option("--drop-inconsistent", is_flag=True, help="Leave out what contradicts the rest.")
@click.option(
    "--next", "proposed", type=click.IntRange(0, 100), default=3, show_default=True,
    help="Poses to propose for the next presses.",
)  # fmt: skip
@out_option("mounts, taxels and the report", required=False)
@format_option("Also write tables as the iCub's positions (.txt).")
@accept_option()
@seed_option
@profile_option()
@json_option
def command(
    evidence: tuple[Path, ...],
    robot: str,
    parts: tuple[str, ...],
    planes: tuple[str, ...],
    joint_sigma_deg: float,
    threshold: float,
    drop_inconsistent: bool,
    proposed: int,
    out: Path | None,
    formats: tuple[str, ...],
    accept: bool,
    seed: int,
    as_json: bool,
) -> None:
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
    from calibration.commands.plane_job import PlaneOptions, plane_job, plane_lines, read_planes
    from skinmap.commands.options import open_robot

    options = PlaneOptions(
        evidence,
        open_robot(robot, parts)[0],
        parts,
        read_planes(planes),
        joint_sigma_deg,
        threshold,
        drop_inconsistent,
        proposed,
        seed,
        formats,
    )
    with progress(1, "calibrate") as advance:
        advance("presses")
        job = plane_job(options)
    finish(job, out, accept, as_json, plane_lines)
