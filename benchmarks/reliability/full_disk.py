"""Every command that writes, on a disk without room: one line, exit code 2, nothing half written.

A part of `make soak` (ARGS="'full disk'"). The system refuses each file beyond so many bytes
(RLIMIT_FSIZE), which writers meet as they meet a full disk.
"""

from __future__ import annotations

import resource
import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks import ROOT

ROOM = 600  # bytes that a file may have: less than any result, more than the head of one
BOARD = ROOT / "docs" / "examples" / "board"
# What is written goes to OUT; IN is a recording in a format, made before there is no room.
COMMANDS = {
    "simulate .npz": "simulate kaspar --part left_hand --per-gesture 1 -o OUT.npz",
    "simulate .mcap": "simulate kaspar --part left_hand --per-gesture 1 -o OUT.mcap",
    "train": "train IN.npz -o OUT.skinmodel",
    "record": "record IN.mcap -o OUT.mcap --speed inf",
    "export csv": "export icub --part left_hand --format csv -o OUT.csv",
    "export icub": "export icub --part left_hand --format icub -o OUT.txt",
    "export urdf": "export icub --part left_hand --format urdf -o OUT.urdf",
    "export mjcf": "export icub --part left_hand --format mjcf -o OUT.xml",
    "export .npz": "export IN.mcap -o OUT.npz",
    "export .h5": "export IN.mcap -o OUT.h5",
    "export .mcap": "export IN.mcap -o OUT.mcap",
    "flatten": "flatten icub --part left_hand -o OUT",
    "evaluate": "evaluate IN.npz --seeds 1 -o OUT",
    "calibrate wrap": f"calibrate wrap --layout {BOARD}/board.csv --mesh {BOARD}/link.stl "
    f"--anchors {BOARD}/anchors.csv -o OUT",
    "calibrate batch": f"calibrate batch {BOARD}/patches.csv -o OUT",
    "calibrate response": f"calibrate response {BOARD}/rest.npy -o OUT",
    "flatten --resume": "flatten icub --part left_hand --resume OUT",
    "calibrate wrap --touches": f"calibrate wrap --layout {BOARD}/board.csv --mesh "
    f"{BOARD}/link.stl --touches {BOARD}/touches.csv -o OUT",
    "calibrate plane": f"calibrate plane {BOARD}/plane/presses.npz --robot icub "
    "--part right_forearm -o OUT",
    "calibrate selftouch": f"calibrate selftouch {BOARD}/selftouch --robot icub "
    "--calibrate left_forearm -o OUT",
    "calibrate wrench": f"calibrate wrench {BOARD}/wrench.npz -o OUT",
    "wiring": f"checkup {BOARD}/wiring/pokes.mcap --part right_forearm "
    f"--places {BOARD}/wiring/places.csv -o OUT.csv",
    "structures": "structures icub --part left_foot -o OUT",
    "merge": "merge IN.mcap IN.mcap -o OUT.mcap",
    "label": "label IN.mcap MARKS.csv -o OUT.mcap",
    "label -o csv": "label IN.npz -o OUT.csv",
    "trade": "trade icub --part left_hand --task flatten --seeds 1 -o OUT",
    "view --screenshot": "view icub --part left_hand --source sim --screenshot OUT.png",
    "view --movie": "view icub --part left_hand --source sim --seconds 1 --movie OUT.gif",
    "view --html": "view icub --part left_hand --source sim --seconds 1 --html OUT.html",
    "view --screenshot glb": "view icub --part left_hand --source sim --screenshot OUT.glb",
    "calibrate wrap --window": f"calibrate wrap --layout {BOARD}/board.csv --mesh {BOARD}/link.stl "
    f"--anchors {BOARD}/anchors.csv --window OUT.png -o OUT",
}


def measure(names: Sequence[str] = tuple(COMMANDS)) -> dict[str, Any]:
    """What each command said, and what was wrong about it ("" where nothing is)."""
    with tempfile.TemporaryDirectory(prefix="skinmap-full-") as name:
        folder = Path(name)
        make_inputs(folder)
        rows = {name: refuse(name, folder) for name in names}
    return {"commands": rows, "faults": sum(bool(row["fault"]) for row in rows.values())}


def make_inputs(folder: Path) -> None:
    """A recording in each format, and the touches of one as a table."""
    from click.testing import CliRunner

    from skinmap.cli.main import cli

    for kind, count in (("npz", 12), ("mcap", 2)):
        words = f"simulate kaspar --part left_hand --per-gesture {count} -o {folder}/in.{kind}"
        made = CliRunner().invoke(cli, words.split())
        if made.exit_code:
            raise RuntimeError(made.output)
    CliRunner().invoke(cli, f"label {folder}/in.mcap -o {folder}/marks.csv".split())


def refuse(name: str, folder: Path, *, room: int = ROOM) -> dict[str, Any]:
    """Run one command while no file may grow beyond `room` bytes."""
    from click.testing import CliRunner

    from skinmap.cli.main import cli
    from skinmap.errors import SkinError, SkinWarning

    place = folder / name.replace(" ", "_")
    place.mkdir()
    text = COMMANDS[name].replace("OUT", str(place / "out")).replace("IN.", f"{folder}/in.")
    text = text.replace("MARKS", f"{folder}/marks")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SkinWarning)
            ran = CliRunner(env={"SKINMAP_CACHE": "off"}).invoke(cli, text.split())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    error = ran.exception
    said = str(error) if isinstance(error, SkinError) else repr(error)
    left = sorted(str(path.relative_to(place)) for path in place.rglob("*") if path.is_file())
    fault = ""
    if not isinstance(error, SkinError):  # those are exit code 2, in one line
        fault = f"no line: {said}"
    elif "cannot" not in said or "\n" in said:
        fault = f"no reason: {said}"
    elif left and name not in ("record", "flatten --resume"):  # what was there in time stays
        fault = f"left {left}"
    return {"said": said.replace(str(place), "").replace(str(folder), ""), "fault": fault}
