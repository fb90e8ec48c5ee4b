"""`skinmap calibrate selftouch`, `wrench` and `response`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, cast

import click

from calibration.commands.mount_jobs import finish
from calibration.commands.options import FILE, accept_option, format_option, units_option
from skinmap.commands.options import json_option, open_robot, outside_option, seed_option
from skinmap.commands.profiles import profile_option
from skinmap.commands.progress import progress

if TYPE_CHECKING:
    from calibration.mount.rigid_mount import Loss

FOLDER = click.Path(path_type=Path, file_okay=False)
loss_option = click.option(
    "--loss", type=click.Choice(["linear", "cauchy"]), default="cauchy", show_default=True,
    help="Squares, or a loss that outliers cannot pull.",
)  # fmt: skip
TABLES = "Also write tables as the iCub's positions (.txt)."


@click.command("selftouch")
@click.argument(
    "recordings", nargs=-1, required=True, type=click.Path(path_type=Path),
    metavar="RECORDING...",
)  # fmt: skip
@click.option(
    "--robot",
    help="Robot that touched itself; without it, its parts are read from beside the recordings.",
)
@outside_option
@click.option(
    "--probes", "probe_file", type=FILE,
    help="Fingertips without taxels (TOML); probes.toml beside the recordings by default.",
)  # fmt: skip
@click.option(
    "--calibrate", "names", multiple=True,
    help="Part whose mount is unknown; may be repeated. All that were touched by default.",
)  # fmt: skip
@click.option(
    "--joint-offsets/--no-joint-offsets", default=None,
    help="Find zero positions of the joints as well; done by default with --robot.",
)  # fmt: skip
@click.option("--keep-all", is_flag=True, help="Keep recordings that contradict the rest.")
@click.option("--drop-inconsistent", is_flag=True, hidden=True)
@loss_option
@click.option("-o", "--out", type=FOLDER, help="Folder for mounts, taxels and the report.")
@format_option(TABLES)
@accept_option()
@seed_option
@profile_option()
@json_option
def selftouch(
    recordings: tuple[Path, ...],
    robot: str | None,
    probe_file: Path | None,
    names: tuple[str, ...],
    joint_offsets: bool | None,
    keep_all: bool,
    drop_inconsistent: bool,
    loss: str,
    out: Path | None,
    formats: tuple[str, ...],
    accept: bool,
    seed: int,
    as_json: bool,
) -> None:
    """Mounts of skin patches from a robot that touches itself: RECORDING files, or a folder.

    Writes mounts.json, a table of taxels (in the frame of their link, with covariances) for each
    part, and report.html. Where the status is not ok, only refused.html is written and the exit
    code is 3, unless --accept. A recording that contradicts the others is left out.

    \b
    Example:  skinmap calibrate selftouch touches.mcap --robot icub -o out
    """
    from calibration.commands.self_touch_job import (
        SelfTouchOptions,
        selftouch_job,
        selftouch_lines,
    )

    if keep_all and drop_inconsistent:
        raise click.UsageError("--keep-all and --drop-inconsistent exclude each other")
    options = SelfTouchOptions(names, joint_offsets, keep_all, cast("Loss", loss), seed, formats)
    with progress(1, "calibrate") as advance:
        advance("self-touch")
        if robot is None:
            from calibration.files.part_files import load_part_touches

            data = load_part_touches(recordings, probe_file)
        else:
            from calibration.files.robot_touches import load_robot_touches

            loaded, _ = open_robot(robot, ())
            data = load_robot_touches(recordings, loaded, probe_file)
        job = selftouch_job(data, options)
    finish(job, out, accept, as_json, selftouch_lines)


@click.command("wrench")
@click.argument("touches", type=FILE)
@units_option("all lengths in the file; moments are newton times this unit")
@click.option(
    "--point-mm", type=click.FloatRange(min=0, min_open=True), default=3.0, show_default=True,
    help="Error of where the skin was pressed.",
)  # fmt: skip
@click.option(
    "--moment-mnm", type=click.FloatRange(min=0, min_open=True), default=5.0, show_default=True,
    help="Error of a moment [mN m].",
)  # fmt: skip
@loss_option
@click.option("--taxels", type=FILE, help="Taxels of the patch: CSV `channel,x,y,z`.")
@click.option("-o", "--out", type=FOLDER, help="Folder for the mount, taxels and the report.")
@format_option(TABLES)
@accept_option()
@seed_option
@profile_option()
@json_option
def wrench(
    touches: Path,
    units: str,
    point_mm: float,
    moment_mnm: float,
    loss: str,
    taxels: Path | None,
    out: Path | None,
    formats: tuple[str, ...],
    accept: bool,
    seed: int,
    as_json: bool,
) -> None:
    """The mount of a rigid patch from the lines of the forces that a force/torque sensor felt.

    TOUCHES is an .npz file with `points (m, 3)` (middle of the active taxels, in the frame of the
    patch), `frames (m, 4, 4)` (link in the sensor's frame), `forces (m, 3)` [N], `moments (m, 3)`
    [N m], and perhaps `taxels (n, 3)` of the patch; or a CSV `touch,x,y,z,fx,fy,fz,mx,my,mz`, with
    `t11` to `t34` (rows of the frame) where the link moves. Without taxels no table is written.

    \b
    Example:  skinmap calibrate wrench touches.npz -o out
    """
    from calibration.commands.wrench_job import wrench_job, wrench_lines

    with progress(1, "calibrate") as advance:
        advance("wrenches")
        job = wrench_job(
            touches,
            units=units,
            point_sigma=1e-3 * point_mm,
            moment_sigma=1e-3 * moment_mnm,
            loss=loss,
            seed=seed,
            taxels=taxels,
            formats=formats,
        )
    finish(job, out, accept, as_json, wrench_lines)


@click.command("response")
@click.argument("rest", type=FILE)
@click.option("--reference", type=FILE, help="Samples under known loads: .npz `samples, loads`.")
@click.option("--sign", type=click.Choice(["1", "-1"]), default="1", show_default=True,
              help="-1 where harder presses read lower.")  # fmt: skip
@click.option("--rate", type=click.FloatRange(min=0, min_open=True), default=50.0,
              show_default=True, help="Samples a second.")  # fmt: skip
@click.option("--robot", default="icub", show_default=True, help="Robot of --part.")
@click.option("--part", help="Part that was measured: the result remembers its skin.")
@click.option("-o", "--out", type=FOLDER, help="Folder for response.npz and the report.")
@accept_option()
@profile_option()
@json_option
def response(
    rest: Path,
    reference: Path | None,
    sign: str,
    rate: float,
    robot: str,
    part: str | None,
    out: Path | None,
    accept: bool,
    as_json: bool,
) -> None:
    """Baseline, noise, threshold, gain and health of each channel.

    REST holds five to ten seconds untouched: .npy or .csv (t, n), or .npz with `samples (t, n)` and
    perhaps `modules (n,)` and `thermal (n,)` (channels that feel temperature only).

    \b
    Example:  skinmap calibrate response rest.npy --reference loads.npz -o out
    """
    from calibration.commands.response_job import response_job, response_lines

    with progress(1, "calibrate") as advance:
        advance("response")
        job = response_job(rest, reference, sign=int(sign), rate=rate, robot=robot, part=part)
    finish(job, out, accept, as_json, response_lines)
