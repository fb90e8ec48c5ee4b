"""What `skinmap inspect` does: numbers, a verdict and a picture of each part, and the page."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray
from skinmap.cli.inspect.result import (
    AngleSpread,
    DrawingMatch,
    InspectResult,
    PartRow,
    RigidFit,
    Spread,
    Standing,
)
from skinmap.geometry.mesh import TriangleMesh
from skinmap.geometry.triangles import face_normals, unit
from skinmap.io.flat_maps.drawing import read_drawing
from skinmap.io.taxels.cyskin import read_cyskin
from skinmap.io.taxels.cyskin_faults import file_faults, set_faults
from skinmap.io.taxels.readers import read_taxels
from skinmap.report.figure import picture_bytes, plain_figure
from skinmap.report.image import image
from skinmap.report.page import facts, heading, page, verdict_lines
from skinmap.report.projection import View, draw_surface
from skinmap.report.result import plain
from skinmap.report.table import cell_text
from skinmap.report.verdict import Verdict
from skinmap.skin.checks import ModuleCheck, check_modules, mirror_distance
from skinmap.skin.cover import FAR, judge_standing
from skinmap.skin.fit import SkinFit, measure_fit
from skinmap.skin.layouts import ModuleLayout, module_layout
from skinmap.skin.modules import module_normals, slots_of
from skinmap.skin.registration import fit_to_mesh
from skinmap.skin.repair import ALL_STEPS, NORMALS, RepairReport, check_steps, repair_table
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin, skin_from_table
from skinmap.skin.taxels import NO_ID
from skinmap.surface.surface_mesh import merge_coincident

MM = 1e3
CYSKIN = ".json"
FAULTY = "usable; its file has faults"
COINCIDENT = 1e-4  # two shells whose taxels are nearer than this are at one place [m]
UNLIKE = 2e-3  # mirror images further apart than this are not of one design [m]
OFF_SIDE = 0.15  # module sides may differ from the layout's by this share: boards are cut and bent
PLACEHOLDER = np.radians(20.0)  # stored normals further off than this are no normals
TURN = np.radians(55.0)  # of each of the two views from where the skin looks
LEVEL = 0.5  # sine: skin that looks further up or down than 60 degrees has no front
MARGIN_MM = 10.0  # round the taxels: what of the link lies further is cut off
TIP_MM = 6.0  # length of the normals drawn
MAX_FACES = 12_000  # of the link: more cannot be seen at this size
FAR_MM = 3.0  # end of the colour scale


def inspect_part(robot: Robot, name: str, *, fit: bool = False) -> PartRow:
    """The numbers of one part of a robot."""
    report, skin, spec = robot.repair(name), robot.skin(name), robot.part(name)
    mesh = robot.mesh_under(name)
    found = measure_fit(skin, mesh)
    angle = np.degrees(found.normal_angle)
    more: dict[str, Any] = {
        "distance_mm": spread(found.distance * MM),
        "frame": robot.frame(name),
        "normal_angle_deg": AngleSpread(
            **_spread(angle), share_within_15=float((angle <= 15.0).mean())
        ),
        "inward": int(found.inward.sum()),
        "covered": int(found.covered.sum()),
    }
    more["standing"] = standing = _standing(skin, mesh, found, spec.cover)
    warnings = [*_fit_warnings(found, standing), *_same_place(robot, name)]
    if spec.layout is not None:
        check = check_modules(report.table, skin, spec.layout, robot.module_frames(name))
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
        more["mirror_mm"] = mirror_distance(report.table.positions, others) * MM
        if more["mirror_mm"] > UNLIKE * MM:
            warnings.append(f"not the mirror image of {twin}: {more['mirror_mm']:.1f} mm apart")
    if fit:
        more["fit"] = _rigid_fit(skin, mesh)
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


def _rigid_fit(skin: Skin, mesh: TriangleMesh) -> RigidFit:
    best = fit_to_mesh(skin.positions, mesh.vertices, mesh.faces)
    return RigidFit(
        mean_before_mm=float(best.before.mean()) * MM,
        mean_after_mm=float(best.after.mean()) * MM,
        shift_mm=best.shift * MM,
        angle_deg=float(np.degrees(best.angle)),
    )


def repair_steps(skipped: Collection[str]) -> tuple[str, ...]:
    """The repair steps less those to leave out.

    Raises
    ------
    UnknownNameError
        A step that does not exist.
    """
    check_steps(skipped)
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
        check = check_modules(report.table, skin, layout, {})
        more["module_side_mm"] = check.side * MM
        warnings += _module_warnings(check, layout.side)
    return _row(report, path.stem, table.link, skin.normals, layout, warnings, faults, **more)


def spread(values: FloatArray) -> Spread:
    """Mean, median, 95th percentile, smallest and largest."""
    return Spread(**_spread(values))


def _spread(values: FloatArray) -> dict[str, float]:
    return {
        "mean": float(values.mean()),
        "median": float(np.median(values)),
        "p95": float(np.percentile(values, 95)),
        "min": float(values.min()),
        "max": float(values.max()),
    }


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
    from skinmap.geometry.proximity import nearest

    table, before = report.table, report.original
    kept = np.isin(before.channels, table.channels)
    stored = before.normals[kept]
    length = np.linalg.norm(stored, axis=1)
    cosine = np.einsum("ij,ij->i", stored, normals) / np.where(length > 0, length, 1.0)
    replaced = int((np.arccos(np.clip(cosine, -1.0, 1.0)) > PLACEHOLDER).sum())
    distinct = len(np.unique(table.positions, axis=0))
    gap, _ = nearest(np.unique(table.positions, axis=0), 1)
    notes = [*faults, *warnings]
    if len(report.rebuilt):
        notes.append(f"{len(report.rebuilt)} taxels shared a place and were rebuilt")
    if len(table.unwired):
        notes.append(
            f"{len(table.unwired)} with a place and no channel: "
            f"rows {_few(np.flatnonzero(table.ids == NO_ID).tolist())}"
        )
    if len(report.unplaced):
        notes.append(f"{len(report.unplaced)} taxels still share a place with others")
    if report.unit != "m":
        notes.append(f"positions were in {report.unit} and were converted")
    pads = len(report.thermal)
    if layout is not None and not pads:
        pads = int(layout.thermal[slots_of(table, layout)].sum())
    shared = merge_coincident(table.positions)[0] != np.arange(len(table))
    return PartRow(
        name=name,
        link=link,
        channels=int(before.channels.max()) + 1,
        taxels=len(table),
        modules=len(np.unique(table.modules)),
        distinct=distinct,
        coincident=int(shared.sum()),
        rebuilt=len(report.rebuilt),
        normals_repaired=replaced,
        unwired=len(table.unwired),
        thermal=pads,
        unit=report.unit,
        pitch_mm=spread(gap[:, 0] * MM),
        verdict=FAULTY if faults else _verdict(notes),
        warnings=notes,
        **more,
    )


def _standing(skin: Skin, mesh: TriangleMesh, found: SkinFit, cover: float) -> Standing:
    judged = judge_standing(skin, mesh, found, cover)
    return Standing(
        why=judged.why,
        far=judged.far,
        cover_mm=cover * MM,
        low_mm=judged.low * MM,
        high_mm=judged.high * MM,
        move_mm=None if np.isnan(judged.shift) else judged.shift * MM,
    )


def _fit_warnings(found: SkinFit, standing: Standing) -> list[str]:
    warnings = []
    if found.inward.any():
        warnings.append(f"{found.inward.sum()} normals point into the body")
    if standing.why == "on it":
        return warnings
    steady = (
        f"the skin stands a steady {np.median(found.distance) * MM:.1f} mm off the link "
        f"({standing.low_mm:.0f} to {standing.high_mm:.0f})"
    )
    if standing.why == "a frame":
        there = f" and its cover of {standing.cover_mm:g} mm" if standing.cover_mm else ""
        warnings.append(
            f"{standing.far} taxels are more than {FAR * MM:.0f} mm off the link{there}: "
            "frame or unit"
        )
    elif standing.why == "a cover":
        said = f", not {standing.cover_mm:g}" if standing.cover_mm else ""
        warnings.append(f"{steady}{said}: a cover? cover_mm says so in the manifest")
    else:
        warnings.append(
            f"{steady}: a cover (cover_mm says so), or its frame is {standing.move_mm:.0f} mm off"
        )
    return warnings


def _same_place(robot: Robot, name: str) -> list[str]:
    """Other parts, or pieces of this one, that stand where it stands: the pose is missing."""
    link, own = robot.part(name).link, robot.repair(name).table
    warnings = []
    shells = [own.positions[own.pieces == k] for k in range(int(own.pieces.max(initial=-1)) + 1)]
    for k, shell in enumerate(shells):
        if any(_coincide(shell, other) for other in shells[:k]):
            warnings.append(f"piece {k + 1} stands where another piece stands: give it a pose")
    for other in robot.parts[: robot.parts.index(name)]:
        if robot.part(other).link == link and _coincide(
            own.positions, robot.repair(other).table.positions
        ):
            warnings.append(f"stands where part {other} stands: give it a pose")
    return warnings


def _coincide(one: FloatArray, other: FloatArray) -> bool:
    """Whether most points (n, 3) lie at points (m, 3)."""
    gap, _ = cKDTree(other).query(one)
    return bool(np.median(gap) < COINCIDENT)


def _module_warnings(check: ModuleCheck, side: float | None) -> list[str]:
    warnings = []
    if check.missing:
        warnings.append(f"no taxels of modules {_few(check.missing)}, which the URDF has")
    if check.swapped:
        pairs = [f"{module} at {there}" for module, there in check.swapped.items()]
        warnings.append(f"modules stand where the URDF has others: {_few(pairs)}")
    if check.rotated:
        warnings.append(f"modules {_few(check.rotated)} are turned in their plane")
    if check.mirrored:
        warnings.append(f"modules {_few(check.mirrored)} are mirrored: their slots run backwards")
    if side is not None and abs(check.side / side - 1.0) > OFF_SIDE:
        warnings.append(f"module side {check.side * MM:.1f} mm, the layout has {side * MM:.1f} mm")
    return warnings


def _few(things: Sequence[Any], most: int = 4) -> str:
    more = f" and {len(things) - most} more" if len(things) > most else ""
    return ", ".join(map(str, things[:most])) + more


def _twin(name: str) -> str:
    if name.startswith("left_"):
        return "right_" + name.removeprefix("left_")
    return "left_" + name.removeprefix("right_") if name.startswith("right_") else ""


def _verdict(warnings: list[str]) -> str:
    """What to do next, in a few words."""
    verdict = "ok"
    if any("swapped" in text or "URDF has others" in text for text in warnings):
        verdict = "check the module numbers against the hardware"
    if any("another skin's" in text for text in warnings):
        verdict = "name the drawing that belongs to the table"
    if any("a cover" in text for text in warnings):
        verdict = "name the cover, or check the frame"
    if any("normals point" in text or "frame or unit" in text for text in warnings):
        verdict = "check frame and unit"
    if any("give it a pose" in text for text in warnings):
        verdict = "give each shape its pose"
    if any("still share" in text for text in warnings):
        verdict = "name the module layout"
    return verdict


def write_inspection(result: InspectResult, robot: Robot | None, path: Path) -> None:
    """Write the page; pictures need the robot's body."""
    sections = []
    for row in result.parts:
        sections += [heading(row.name), verdict_lines(Verdict(row.verdict, row.warnings))]
        if robot is not None:
            sections.append(image(part_picture(robot, row.name), row.name))
        sections.append(facts(_numbers(row)))
    path.write_text(page(f"{result.robot}: skin", sections), encoding="utf-8")


def part_picture(robot: Robot, name: str) -> bytes:
    """PNG of a part from two sides: link in grey, taxels coloured by their distance to it."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize, to_rgba

    skin, mesh = robot.skin(name), robot.mesh_under(name)
    found, cover = measure_fit(skin, mesh), robot.part(name).cover
    figure = plain_figure((10.0, 4.9))
    axes = figure.subplots(1, 2)
    scale = Normalize(0.0, FAR_MM)
    faces = mesh.faces[:: max(1, len(mesh.faces) // MAX_FACES)]
    normals = face_normals(mesh.vertices, faces)
    grey = np.tile(to_rgba("#c9ced4"), (len(faces), 1))
    for axis, view in zip(axes, _views(skin), strict=True):
        # Open and double shells have faces of both turns: none is left out.
        draw_surface(axis, view, mesh.vertices[faces] * MM, normals, grey, both_sides=True)
        seen = skin.normals @ view.out > 0.0
        points = view.project(skin.positions * MM)
        tips = view.project(skin.positions * MM + TIP_MM * skin.normals)
        for start, end in zip(points[seen][::5], tips[seen][::5], strict=True):
            axis.plot(*np.stack([start, end])[:, :2].T, color="#303030", linewidth=0.6)
        distance = np.abs(found.distance[seen] - cover) * MM
        axis.scatter(*points[seen][:, :2].T, c=distance, s=9, cmap="viridis", norm=scale, zorder=3)
        axis.set_xlim(points[:, 0].min() - MARGIN_MM, points[:, 0].max() + MARGIN_MM)
        axis.set_ylim(points[:, 1].min() - MARGIN_MM, points[:, 1].max() + MARGIN_MM)
        axis.set_aspect("equal")
        axis.set_title(view.name, fontsize=9, y=1.0)
        axis.set_xlabel("mm", fontsize=8)
        axis.tick_params(labelsize=7)
    bar = figure.colorbar(ScalarMappable(scale, "viridis"), ax=axes, shrink=0.7, extend="max")
    off = f"the cover of {cover * MM:g} mm" if cover else "the link"
    bar.set_label(f"distance to {off} [mm]")
    return picture_bytes(figure)


def _views(skin: Skin) -> list[View]:
    """From the left and the right of where the skin looks, the robot's upward direction up."""
    looks = skin.normals.mean(axis=0)
    up = np.array([0.0, 0.0, 1.0]) if skin.up is None else skin.up
    if np.linalg.norm(np.cross(up, looks)) < LEVEL * np.linalg.norm(looks):
        # A sole looks down: its length is up in the picture.
        up = np.linalg.svd(skin.positions - skin.positions.mean(axis=0), full_matrices=False)[2][0]
    front = unit(looks - (looks @ up) * up)
    side = np.cross(up, front)
    views = []
    for name, turn in zip(("from the left", "from the right"), (-TURN, TURN), strict=True):
        views.append(View(name, np.cos(turn) * front + np.sin(turn) * side, up))
    return views


def _numbers(row: PartRow) -> list[tuple[str, str]]:
    """Every figure of a part in words."""
    rows = []
    for key, value in plain(row).items():
        if key in ("name", "verdict", "warnings"):
            continue
        if isinstance(value, Mapping):
            text = ", ".join(f"{name} {cell_text(one)}" for name, one in value.items())
        else:
            text = cell_text(value, 4)
        rows.append((key, text or "-"))
    return rows
