"""The window of `skinmap calibrate wrap --window`: click taxels and their points."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from skinmap.errors import InvalidArrayError
from skinmap.report.present import present

if TYPE_CHECKING:
    from calibration.commands.calibration_options import Outputs, PatchFiles
    from viewer.anchors.view import CalibrationView


def pick(files: PatchFiles, output: Outputs, picture: Path | None) -> None:
    """Calibrate a patch by clicks: open the window, or write its picture and save.

    Raises
    ------
    click.UsageError
        No display for a window.
    MissingLibraryError
        No OpenGL.
    InvalidArrayError
        Nothing was solved: too few anchors, or anchors without a solution.
    """
    from calibration.commands.patch_task import patch_lines
    from calibration.commands.results import judged
    from skinmap.display import has_display, require_opengl

    require_opengl()
    if picture is None and not has_display():
        raise click.UsageError("there is no display here: give --anchors and --window FILE.png")
    from calibration.commands.anchor_session import AnchorSession
    from viewer.anchors.view import CalibrationView, run

    session = AnchorSession.load(files)
    view = CalibrationView(session, off_screen=picture is not None, output=output)
    if picture is None:
        run(view)
    else:
        _draw(view, picture)
    solution = session.solution
    if solution is None or solution.solved is None:
        raise InvalidArrayError(solution.problem if solution else "no anchors were picked")
    result = solution.solved.result
    present(
        replace(result, files=list(view.saved)),
        lambda one: [*judged(one), *patch_lines(one)],
        as_json=output.as_json,
        inside=output.out,
        verdict=result.verdict(accept=output.accept),
    )


def _draw(view: CalibrationView, picture: Path) -> None:
    import imageio.v3 as iio

    from skinmap.io.output import staged_file

    with staged_file(picture) as path:
        try:
            view.save()
            view.refresh()
            iio.imwrite(path, view.frame())
        finally:
            view.shut()


@click.command("anchors", hidden=True, context_settings={"ignore_unknown_options": True})
@click.argument("rest", nargs=-1, type=click.UNPROCESSED)
def anchors(rest: tuple[str, ...]) -> None:
    """The former name of `skinmap calibrate wrap --window`."""
    words = " ".join(rest).replace("--screenshot", "--window") or "--layout FILE --mesh FILE"
    window = "" if "--window" in words else " --window"
    raise click.UsageError(f"anchors was renamed: write skinmap calibrate wrap {words}{window}")
