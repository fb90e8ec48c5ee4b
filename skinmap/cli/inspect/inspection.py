"""What `skinmap inspect` does: the numbers and the verdict, part by part."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.cli.inspect.result import AngleSpread, DrawingMatch, PartRow, RigidFit, Spread
from skinmap.geometry.mesh import TriangleMesh
from skinmap.io.flat_maps.drawing import read_drawing
from skinmap.io.taxels.readers import read_taxels
from skinmap.skin.checks import ModuleCheck, check_modules, mirror_distance
from skinmap.skin.fit import SkinFit, measure_fit
from skinmap.skin.layouts import ModuleLayout, module_layout
from skinmap.skin.modules import module_normals, slots_of
from skinmap.skin.registration import fit_to_mesh
from skinmap.skin.repair import ALL_STEPS, NORMALS, RepairReport, check_steps, repair_table
from skinmap.skin.robot import Robot
from skinmap.skin.skin import Skin, skin_from_table
from skinmap.surface.surface_mesh import merge_coincident

MM = 1e3
FAR = 5e-3  # a taxel further from its link than this is not on it [m]
UNLIKE = 2e-3  # mirror images further apart than this are not of one design [m]
OFF_SIDE = 0.15  # module sides may differ from the layout's by this share: boards are cut and bent
PLACEHOLDER = np.radians(20.0)  # stored normals further off than this are no normals


def inspect_part(robot: Robot, name: str, *, fit: bool = False) -> PartRow:
    """The numbers of one part of a robot."""
    report, skin, spec = robot.repair(name), robot.skin(name), robot.part(name)
    mesh = robot.mesh(spec.link)
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
    warnings = _fit_warnings(found)
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


def inspect_table(path: Path, module: str | None, steps: Collection[str]) -> PartRow:
    """The numbers of a bare table without a body."""
    layout = None if module is None else module_layout(module)
    table = read_taxels(path)
    report = repair_table(table, layout, steps=steps)
    hint = None if layout is None else module_normals(report.table, layout)
    keep = NORMALS not in steps
    skin = skin_from_table(report.table, None, path.stem, table.link, hint=hint, keep_normals=keep)
    more: dict[str, Any] = {"distance_mm": None}
    warnings: list[str] = []
    if layout is not None:
        check = check_modules(report.table, skin, layout, {})
        more["module_side_mm"] = check.side * MM
        warnings += _module_warnings(check, layout.side)
    return _row(report, path.stem, table.link, skin.normals, layout, warnings, **more)


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
    notes = list(warnings)
    if len(report.rebuilt):
        notes.append(f"{len(report.rebuilt)} taxels shared a place and were rebuilt")
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
        thermal=pads,
        unit=report.unit,
        pitch_mm=spread(gap[:, 0] * MM),
        verdict=_verdict(notes),
        warnings=notes,
        **more,
    )


def _fit_warnings(found: SkinFit) -> list[str]:
    warnings = []
    if found.inward.any():
        warnings.append(f"{found.inward.sum()} normals point into the body")
    far = int((found.distance > FAR).sum())
    if far:
        warnings.append(f"{far} taxels are more than {FAR * MM:.0f} mm off the link: frame or unit")
    return warnings


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
    if any("normals point" in text or "off the link" in text for text in warnings):
        verdict = "check frame and unit"
    if any("still share" in text for text in warnings):
        verdict = "name the module layout"
    return verdict
