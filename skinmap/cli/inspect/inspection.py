"""What `skinmap inspect` does: numbers and a verdict of each part."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray
from skinmap.cli.inspect.inspect_result import DrawingMatch, PartRow, Spread
from skinmap.errors import InvalidMeshError, check_known
from skinmap.io.flat_maps.drawing import read_drawing
from skinmap.io.taxels.cyskin import file_faults, read_cyskin, set_faults
from skinmap.io.taxels.taxel_table import read_taxels
from skinmap.skin.checks import ModuleCheck, mirror_distance
from skinmap.skin.cover import FAR, SkinFit, Standing, judge_standing, measure_fit
from skinmap.skin.modules import ModuleLayout, module_layout, module_normals
from skinmap.skin.repair import ALL_STEPS, NORMALS, RepairReport, repair_table
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin, skin_from_table
from skinmap.skin.taxels import NO_ID, TaxelTable
from skinmap.summary import first_few
from skinmap.surface.surface_mesh import build_surface

MM = 1e3
CYSKIN = ".json"
FAULTY = "usable; its file has faults"
COINCIDENT = 1e-4  # two shells whose taxels are nearer than this are at one place [m]
UNLIKE = 2e-3  # mirror images further apart than this are not of one design [m]
OFF_SIDE = 0.15  # module sides may differ from the layout's by this share: boards are cut and bent
NO_MESH, NO_SURFACE = "has no mesh", "no surface"
PLACEHOLDER = np.radians(20.0)  # stored normals further off than this are no normals


def inspect_part(robot: Robot, name: str) -> PartRow:
    """The numbers of one part of a robot."""
    report, skin, spec = robot.repair(name), robot.skin(name), robot.part(name)
    mesh = robot.mesh_under(name)
    more: dict[str, Any] = {"distance_mm": None, "frame": robot.frame(name)}
    warnings = [f"link {spec.link!r} {NO_MESH}: distances from it are not known"]
    if len(mesh.faces):
        found = measure_fit(skin, mesh)
        more |= {
            "distance_mm": spread(found.distance * MM),
            "normal_angle_deg": spread(np.degrees(found.normal_angle)),
            "inward": int(found.inward.sum()),
            "covered": int(found.covered.sum()),
        }
        standing = judge_standing(skin, mesh, found, spec.cover)
        warnings = [*_fit_warnings(found, standing, spec.cover * MM)]
    if len(skin) < 3:
        warnings.append("too few taxels for a surface: each stands for a disc")
    warnings += _without_surface(skin)
    warnings += _same_place(robot, name)
    if spec.layout is not None:
        check = ModuleCheck(report.table, skin, spec.layout, robot.module_frames(name))
        more["module_side_mm"] = check.side * MM
        more["swapped"] = {str(module): there for module, there in check.swapped.items()}
        warnings += _module_warnings(check, spec.layout.side)
    if spec.drawing is not None:
        more["drawing"] = match = _drawing_match(report, spec.drawing)
        if match.missing or match.extra:
            warnings.append(
                f"{spec.drawing.name} is another skin's: {match.missing} taxels are not drawn, "
                f"{match.extra} drawn ones are not in the table"
            )
    twin = _twin(name)
    if twin in robot.parts:
        others = robot.repair(twin).table.positions
        apart = mirror_distance(report.table.positions, others)
        if apart > UNLIKE:
            warnings.append(f"not the mirror image of {twin}: {apart * MM:.1f} mm apart")
    return _row(report, name, spec.link, skin.normals, spec.layout, warnings, **more)


def file_faults_of(paths: Sequence[Path]) -> dict[Path, list[str]]:
    """Faults of the CySkin files among some tables, and those that they have together."""
    read = {path: read_cyskin(path) for path in paths if path.suffix.lower() == CYSKIN}
    names = {path: path.name for path in read}
    if len(set(names.values())) < len(names):
        names = {path: str(path) for path in read}
    together = set_faults({names[path]: found for path, found in read.items()})
    return {
        path: [*file_faults(found, path.name), *together[names[path]]]
        for path, found in read.items()
    }


def _drawing_match(report: RepairReport, path: Path) -> DrawingMatch:
    drawn, channels = read_drawing(path).channels, report.table.channels
    return DrawingMatch(
        taxels=len(drawn),
        missing=len(np.setdiff1d(channels, drawn)),
        extra=len(np.setdiff1d(drawn, channels)),
    )


def repair_steps(skipped: Collection[str]) -> tuple[str, ...]:
    """The repair steps less those to leave out.

    Raises
    ------
    UnknownNameError
        A step that does not exist.
    """
    check_known("repair step", skipped, ALL_STEPS)
    return tuple(step for step in ALL_STEPS if step not in skipped)


def inspect_table(
    path: Path, module: str | None, steps: Collection[str], faults: Sequence[str] = ()
) -> PartRow:
    """The numbers of a bare table without a body; `faults` are known of its file."""
    layout = None if module is None else module_layout(module)
    table = read_taxels(path)
    report = repair_table(table, layout, steps=steps)
    hint = None if layout is None else module_normals(report.table, layout)
    if hint is None and table.normals.any() and path.suffix.lower() == CYSKIN:
        hint = report.table.normals
    keep = NORMALS not in steps
    skin = skin_from_table(report.table, None, path.stem, table.link, hint=hint, keep_normals=keep)
    more: dict[str, Any] = {"distance_mm": None}
    warnings: list[str] = []
    if layout is not None:
        check = ModuleCheck(report.table, skin, layout, {})
        more["module_side_mm"] = check.side * MM
        warnings += _module_warnings(check, layout.side)
    return _row(report, path.stem, table.link, skin.normals, layout, warnings, faults, **more)


def spread(values: FloatArray) -> Spread:
    """Mean, median, 95th percentile, smallest and largest."""
    return Spread(
        mean=float(values.mean()),
        median=float(np.median(values)),
        p95=float(np.percentile(values, 95)),
        min=float(values.min()),
        max=float(values.max()),
    )


def _row(
    report: RepairReport,
    name: str,
    link: str,
    normals: FloatArray,
    layout: ModuleLayout | None,
    warnings: list[str],
    faults: Sequence[str] = (),
    **more: Any,
) -> PartRow:
    from skinmap.surface.taxel_cloud import gaps_on_one_side

    table, before = report.table, report.original
    kept = np.isin(before.channels, table.channels)
    stored = before.normals[kept]
    length = np.linalg.norm(stored, axis=1)
    cosine = np.einsum("ij,ij->i", stored, normals) / np.where(length > 0, length, 1.0)
    replaced = int((np.arccos(np.clip(cosine, -1.0, 1.0)) > PLACEHOLDER).sum())
    notes = [*faults, *warnings]
    if len(report.rebuilt):
        notes.append(f"{len(report.rebuilt)} taxels shared a place and were rebuilt")
    if len(table.unwired):
        notes.append(
            f"{len(table.unwired)} with a place and no channel: "
            f"rows {first_few(np.flatnonzero(table.ids == NO_ID).tolist())}"
        )
    notes += _shared_places(table, layout)
    if np.array_equal(np.sort(before.channels), np.arange(1, len(before) + 1)):
        notes.append(
            "channels begin at 1, and the first value of a sample is channel 0: if they count from "
            "1 there too, every touch is a taxel off"
        )
    if report.unit != report.stated:
        notes.append(f"positions were in {report.unit} and were converted")
    return PartRow(
        name=name,
        link=link,
        channels=int(before.channels.max()) + 1,
        taxels=len(table),
        modules=len(np.unique(table.modules)),
        rebuilt=len(report.rebuilt),
        normals_repaired=replaced,
        unwired=len(table.unwired),
        unit=report.unit,
        pitch_mm=spread(gaps_on_one_side(table.positions, normals) * MM),
        verdict=FAULTY if faults else _verdict(notes),
        warnings=notes,
        **more,
    )


def _shared_places(table: TaxelTable, layout: ModuleLayout | None) -> Iterator[str]:
    """Modules whose taxels all lie at one place, and other channels that share one."""
    _, place = np.unique(table.positions, axis=0, return_inverse=True)
    whole, alike = [], {}
    for here in np.flatnonzero(np.bincount(place.ravel()) > 1).tolist():
        rows = np.flatnonzero(place.ravel() == here)
        module = np.flatnonzero(table.modules == table.modules[rows[0]])
        if layout is None and len(rows) > 2 and np.array_equal(rows, module):
            whole.append(int(table.modules[rows[0]]))
        else:
            alike[here] = " and ".join(map(str, table.channels[rows].tolist()))
    yield from (f"all taxels of module {module} are at one place" for module in whole[:4])
    if alike:
        yield f"channels at one place: {first_few(list(alike.values()))}"


def _fit_warnings(found: SkinFit, standing: Standing, cover_mm: float) -> Iterator[str]:
    if found.inward.any():
        yield f"{found.inward.sum()} normals point into the body"
    if standing.why == "on it":
        return
    steady = (
        f"the skin stands a steady {np.median(found.distance) * MM:.1f} mm off the link "
        f"({standing.low * MM:.0f} to {standing.high * MM:.0f})"
    )
    if standing.why == "a frame":
        there = f" and its cover of {cover_mm:g} mm" if cover_mm else ""
        far = f"{standing.far} taxels are more than {FAR * MM:.0f} mm off the link{there}"
        yield f"{far}: frame or unit"
    elif standing.why == "a cover":
        said = f", not {cover_mm:g}" if cover_mm else ""
        yield f"{steady}{said}: a cover? set cover_mm in the manifest"
    else:
        yield f"{steady}: a cover (set cover_mm), or its frame is {standing.shift * MM:.0f} mm off"


def _same_place(robot: Robot, name: str) -> Iterator[str]:
    """Other parts, or pieces of this one, that stand where it stands: the pose is missing."""
    link, own = robot.part(name).link, robot.repair(name).table
    shells = [own.positions[own.pieces == k] for k in range(int(own.pieces.max(initial=-1)) + 1)]
    for k, shell in enumerate(shells):
        if any(_coincide(shell, other) for other in shells[:k]):
            yield f"piece {k + 1} stands where another piece stands: give it a pose"
    for other in robot.parts[: robot.parts.index(name)]:
        if robot.part(other).link == link and _coincide(
            own.positions, robot.repair(other).table.positions
        ):
            yield f"stands where part {other} stands: give it a pose"


def _coincide(one: FloatArray, other: FloatArray) -> bool:
    """Whether most points (n, 3) lie at points (m, 3)."""
    gap, _ = cKDTree(other).query(one)
    return bool(np.median(gap) < COINCIDENT)


def _without_surface(skin: Skin) -> list[str]:
    """Taxels that are too far from the others to be joined to a surface."""
    try:
        left_out = build_surface(skin).left_out()
    except InvalidMeshError as error:
        return [f"{NO_SURFACE}: {error}"]
    return [left_out] if left_out else []


def _module_warnings(check: ModuleCheck, side: float | None) -> Iterator[str]:
    if check.missing:
        yield f"no taxels of modules {first_few(check.missing)}, which the URDF has"
    if check.swapped:
        pairs = [f"{module} at {there}" for module, there in check.swapped.items()]
        yield f"modules stand where the URDF has others: {first_few(pairs)}"
    if check.rotated:
        yield f"modules {first_few(check.rotated)} are turned in their plane"
    if check.mirrored:
        yield f"modules {first_few(check.mirrored)} are mirrored: their slots run backwards"
    if check.misfit:
        size = f" ({check.scale:.2f} times its size)" if abs(check.scale - 1.0) > 0.01 else ""
        yield f"modules {first_few(check.misfit)} do not fit the layout{size}"
    if 2 * max(len(check.misfit), len(check.mirrored)) > check.modules:
        yield "most modules are not of this layout: compare slots, side and sense"
    if side is not None and abs(check.side / side - 1.0) > OFF_SIDE:
        yield f"module side {check.side * MM:.1f} mm, the layout has {side * MM:.1f} mm"


def _twin(name: str) -> str:
    if name.startswith("left_"):
        return "right_" + name.removeprefix("left_")
    return "left_" + name.removeprefix("right_") if name.startswith("right_") else ""


# What to do next where a warning says one of these; the last one that holds.
VERDICTS = {
    "check the taxels without a surface": ("in no triangle", NO_SURFACE),
    "check the module numbers against the hardware": ("swapped", "URDF has others"),
    "check the module layout": ("most modules",),
    "name the drawing that belongs to the table": ("another skin's",),
    "check the places of these channels": ("channels at one place",),
    "name the cover, or check the frame": ("a cover",),
    "check frame and unit": ("normals point", "frame or unit"),
    "check the link, which has no mesh": (NO_MESH,),
    "give each shape its pose": ("give it a pose",),
    "name the module layout": ("all taxels of module",),
}


def _verdict(warnings: list[str]) -> str:
    """What to do next, in a few words."""
    said = "\n".join(warnings)
    held = [verdict for verdict, signs in VERDICTS.items() if any(one in said for one in signs)]
    return held[-1] if held else "ok"
