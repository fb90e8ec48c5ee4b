"""`skinmap flatten`: flat maps of the skin and what they distort."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from skinmap.commands import options
from skinmap.commands.progress import progress
from skinmap.errors import (
    InvalidArrayError,
    MissingFileError,
    OutputError,
    UnknownNameError,
    check_known,
)
from skinmap.flat.flat_rows import ComparedRow, PatchRow
from skinmap.report.present import present
from skinmap.report.table import Cell, Table
from skinmap.rows import column, row

if TYPE_CHECKING:
    from skinmap.flat.costs import DrawnChart
    from skinmap.flat.flat_map import FlatMap
    from skinmap.io.flat_maps.sources import Source
    from skinmap.surface.surface_mesh import SurfaceMesh

LONG, SLIT = (10.0, 50.0), 4.05  # edge errors [%] that a hint follows, and the energy it names
KNOBS = ("iterations", "max_seconds", "max_edge_rms", "metric")
ISOMETRY = 4.0  # as `skinmap.flat.flat_map` has it; a test compares
EDGE_STRAIN = "edge_strain"
PATCHES = (
    "part patch vertices faces holes cut_mm method flips quasi_conformal.mean quasi_conformal.max "
    "area_sd symmetric_dirichlet.mean symmetric_dirichlet.max stretch_l2 edge_rms_percent "
    "geodesic_stress geodesic_stress_error seconds"
)
COMPARED = (
    "part patch with_ taxels flips quasi_conformal.mean quasi_conformal.max area_sd "
    "symmetric_dirichlet.mean symmetric_dirichlet.max edge_rms_percent distance_mm seconds"
)
MESHES = {".stl", ".obj", ".ply", ".off", ".dae", ".glb", ".gltf", ".3mf"}


@row
class FlattenResult:
    """Flat maps and what they distort."""

    robot: str = column("Name of the robot, or those of the files with commas between.")
    method: str = column("Method that was asked for.")
    meshing: str | None = column("Meshing method; null for files that are surfaces already.")
    iterations: int | None = column("Iterations, by the profile; null: the method's own.")
    seam: str = column('How seams were placed: "shortest", "contacts", "file" or "none".')
    metric: str = column("Metric that colours the maps and chooses the worst triangles.")
    patches: list[PatchRow] = column("Part by part, in the order of the command line.")
    compare: list[ComparedRow] = column("By `--compare`, in the same order.")
    seconds: float = column("CPU time of all solves.")
    sheets: Sequence[str] = column("Files of `--sheet`, a page each but for PDF.", default=())
    files: Sequence[str] = column("Names of the files inside `--out`.", default=())


class Laid(NamedTuple):
    """A part laid flat, by other methods too, and as others drew it."""

    flat: FlatMap
    others: Mapping[str, FlatMap]
    drawn: Mapping[str, Sequence[DrawnChart]]


@click.command("flatten")
@click.argument("robots", nargs=-1, metavar="[ROBOT|MESH...]")
@options.part_option
@options.word("--method", "METHOD", "Flattening method.  [default: balanced]")
@options.word(
    "--meshing", "METHOD", "Surface meshing method.  [default: consensus; the faces of a .json]"
)
@options.word(
    "--compare",
    "M2,M3|drawing[:FILE]|theirs",
    "Methods to compare with, `drawing` for a hand-drawn map (the part's, or one of iCubSkinGui "
    ".ini or CySkin .json), `theirs` for the file's own.",
    default="",
)
@options.word(
    "--seam",
    "SEAM",
    "Seams of patches that are not discs: contacts:RECORDING (dividing fewest touches), "
    "shortest, a file of channels, or none (tubes: a map that repeats itself).  "
    "[default: shortest]",
    default="shortest",
)
@options.number(
    "--max-distortion",
    ISOMETRY,
    1e6,
    "Slit each chart until its mean symmetric Dirichlet energy is below this, as 4.1.",
)
@options.out_folder("pictures, OBJ with texture coordinates, and report.html")
@options.file_option(
    "--sheet",
    options.Written(".pdf", ".svg", ".dxf"),
    "Write the maps at their true size on A4, with the channel of each taxel; more pages than one "
    "of SVG or DXF are FILE-1, FILE-2, ...",
)
@options.workers_options(resume=False)
@options.profile_option("flatten", beside=KNOBS)
@options.prints(FlattenResult)
def command(
    robots: tuple[str, ...],
    parts: tuple[str, ...],
    out: Path | None,
    sheet: Path | None,
    as_json: bool,
    **asked: Any,
) -> None:
    """Lay every patch of a robot's skin, or any triangle mesh, flat and measure the distortion.

    ROBOT is a built-in name (default: icub), the path of a manifest, or one or several mesh files
    (OBJ, STL, PLY, OFF, ...) or CySkin files (.json), whose own faces are taken.
    Methods are tutte, harmonic, lscm, bff, arap, slim, dirichlet, or by
    price fast, balanced, accurate, auto; meshing is consensus, fast or accurate. Triangles are
    coloured by their edge strain, or by the `metric` of a profile.

    \b
    Example:  skinmap flatten icub --part torso --out maps
              skinmap flatten icub --part left_arm --compare bff,lscm --json
              skinmap flatten bunny.obj --method accurate --json
              skinmap flatten skin.json --compare theirs
              skinmap flatten icub --part left_forearm --sheet sheet.pdf
              skinmap flatten sleeve.toml --seam contacts:touches.npz --out maps
              skinmap flatten scans/*.stl --jobs 4 --json
    """
    if sheet is not None and not sheet.parent.is_dir():
        raise OutputError(f"cannot write {str(sheet)!r}: no folder {str(sheet.parent)!r}")
    result, laid = work(robots or ("icub",), parts, **asked)
    if sheet is not None:
        result = replace(result, sheets=_write_sheets(sheet, result.robot, laid))
    with progress(len(laid) if out else 0, "drawing") as advance:
        present(
            result,
            _lines,
            as_json=as_json,
            out=out,
            write=lambda stage: write_files(result, laid, stage, advance),
            page=lambda stage: report_page(result, laid, stage),
        )


def work(
    robots: Sequence[str],
    parts: Sequence[str] = (),
    *,
    method: str | None = None,
    compare: str = "",
    meshing: str | None = None,
    seam: str = "shortest",
    max_edge_rms: float | None = None,
    metric: str | None = None,
    spread: options.WorkerOptions = options.ALONE,
    **how: Any,
) -> tuple[FlattenResult, dict[str, Laid]]:
    """Lay everything flat and measure it; `how` is passed on to `skinmap.flatten`."""
    from skinmap.flat.costs import drawing_rows, drawn_charts, face_metric, method_rows, patch_rows
    from skinmap.flat.flat_map import DEFAULT, FlatMap
    from skinmap.flat.methods import check_budget, flatteners
    from skinmap.io.flat_maps.sources import DRAWING, THEIRS, check_others
    from skinmap.parallel.run import run_tasks

    bound = how.get("max_distortion")
    if method is None:  # a bound is kept by the method that minimises what it bounds
        budget = how.get("max_seconds") or max_edge_rms
        method = "auto" if budget else DEFAULT if bound is None else "dirichlet"
    words = [word.strip().partition(":") for word in compare.split(",") if word.strip()]
    names = {name: Path(path) if path else None for name, _, path in words}
    drawing = names.get(DRAWING)
    others = [name for name in names if name not in (DRAWING, THEIRS)]
    for name in (method, *others):
        flatteners.get(name)
    check_budget(method, {"max_seconds": how.get("max_seconds"), "max_edge_rms": max_edge_rms})
    colour = face_metric(metric := metric or EDGE_STRAIN)
    kind, path = _seam(seam)
    if kind == "none" and bound is not None:
        raise InvalidArrayError("--seam none cuts nothing: leave out --max-distortion")
    how["max_edge_rms"] = max_edge_rms
    title, meshing, sources = _sources(robots, parts, meshing)
    check_others(title, sources, names, drawing)
    with spread.open("flatten") as workers, progress(len(sources), "flatten") as advance:
        meshes = {part: source.surface() for part, source in sources.items()}
        seams = _seams(kind, path, meshes)
        tasks = [(mesh, method, others, seams[part], how) for part, mesh in meshes.items()]
        found = run_tasks(_lay_flat, tasks, workers=workers, progress=advance)
    laid, patches, compared = {}, [], []
    for (part, mesh), charts in zip(meshes.items(), found, strict=True):
        maps = {name: FlatMap(mesh, *own) for name, own in charts.items()}
        flat = maps.pop("")
        drawings = sources[part].others(names, drawing, len(mesh.skin)).items()
        drawn = {name: drawn_charts(flat, one.channels, one.xy) for name, one in drawings}
        laid[part] = Laid(flat, maps, drawn)
        patches += patch_rows(part, flat, colour)
        for name, other in maps.items():
            compared += method_rows(part, name, other)
        for name, sketch in drawn.items():
            compared += drawing_rows(part, name, flat, sketch)
    result = FlattenResult(
        robot=title,
        method=method,
        meshing=meshing,
        iterations=how.get("iterations"),
        seam=kind,
        metric=metric,
        patches=patches,
        compare=compared,
        seconds=sum(one.seconds for one in patches),
    )
    return result, laid


def _lay_flat(task: tuple[SurfaceMesh, str, list[str], dict[str, Any], dict[str, Any]]) -> Any:
    """Charts and coordinates of a part by each method, the first under no name."""
    from skinmap.flat.flat_map import flatten

    mesh, method, others, seam, how = task
    maps = {"": flatten(mesh, method=method, **seam, **how)}
    maps |= {name: flatten(mesh, method=name, **seam) for name in others}
    return {name: (flat.charts, flat.uv) for name, flat in maps.items()}


def _sources(
    robots: Sequence[str], parts: Sequence[str], meshing: str | None
) -> tuple[str, str | None, dict[str, Source]]:
    """What the arguments name together, how it is meshed, and its parts."""
    from skinmap.io.flat_maps.sources import file_sources, robot_sources
    from skinmap.surface.surface_mesh import DEFAULT, MESHING

    check_known("meshing method", [meshing] if meshing is not None else [], MESHING)
    paths = [Path(robot) for robot in dict.fromkeys(robots)]
    suffixes = {path.suffix.lower() for path in paths}
    if suffixes <= MESHES or suffixes == {".json"}:
        if parts:
            raise UnknownNameError("part", parts[0], ())
        files = file_sources(paths, meshing)
        return ", ".join(files), None if suffixes <= MESHES else meshing, files
    if len(robots) > 1:
        raise click.UsageError(
            "several mesh files, several CySkin files, or one robot: not " + " ".join(robots)[:200]
        )
    robot, names = options.open_robot(robots[0], tuple(parts))
    return robot.name, meshing or DEFAULT, robot_sources(robot, names, meshing or DEFAULT)


def _seam(words: str) -> tuple[str, Path | None]:
    """The kind of seam that `--seam` asks for, and its file."""
    if words in ("shortest", "none"):
        return words, None
    kind, _, recording = words.partition(":")
    if kind == "contacts":
        if not recording:
            raise click.UsageError("write --seam contacts:RECORDING")
        path, expected = Path(recording), "a recording of touches, for --seam contacts:RECORDING"
    else:
        kind, path = "file", Path(words)
        expected = "for --seam contacts:RECORDING, shortest, none, or a file of channels"
    if not path.is_file():
        raise MissingFileError(path, expected)
    return kind, path


def _seams(
    kind: str, path: Path | None, meshes: Mapping[str, SurfaceMesh]
) -> dict[str, dict[str, Any]]:
    """By part, the keywords of `skinmap.flatten` that say where its seams run."""
    from skinmap.io.flat_maps.seam_files import read_cuts, recorded_touches

    found: dict[str, dict[str, Any]] = {part: {"periodic": kind == "none"} for part in meshes}
    if path is not None:
        name, read = ("touches", recorded_touches) if kind == "contacts" else ("cuts", read_cuts)
        for part, own in read(path, meshes).items():
            found[part][name] = own
    return found


def _write_sheets(path: Path, name: str, laid: Mapping[str, Laid]) -> list[str]:
    """Write the maps at their true size; the files."""
    from skinmap.commands.overwriting import protect
    from skinmap.report.sheet import sheets, write_sheets

    pages = sheets(name, {part: one.flat for part, one in laid.items()})
    return [str(file) for file in write_sheets(path, pages, partial(protect, option="--sheet"))]


def write_files(
    result: FlattenResult, laid: Mapping[str, Laid], stage: Path, advance: Callable[[str], None]
) -> Iterator[str]:
    """Write pictures and the meshes of each part into a folder; the names."""
    from skinmap.flat.costs import face_metric
    from skinmap.io.flat_maps.seam_files import write_flat_obj
    from skinmap.report.flat_figures import comparison_figure, part_figure
    from skinmap.report.page import save_figure

    metric = face_metric(result.metric)
    stems = file_stems(laid)
    for part, one in laid.items():
        advance(part)
        stem = stems[part]
        picture, mesh, compared = _files(part, stem)
        save_figure(part_figure(one.flat, metric), stage / picture)
        write_flat_obj(one.flat, stage / mesh)
        yield from (picture, mesh)
        if one.others or one.drawn:
            maps = [(result.method, one.flat), *one.others.items()]
            (stage / compared).write_bytes(comparison_figure(maps, one.drawn, metric))
            yield compared


def report_page(result: FlattenResult, laid: Mapping[str, Laid], stage: Path) -> str:
    """The page, with the pictures that were written."""
    from skinmap.flat.costs import face_metric
    from skinmap.report.page import heading, media, note, page

    metric, stems = face_metric(result.metric), file_stems(laid)
    words = (
        f"Coloured by: {metric.label}. Distortion at the scale that keeps the whole area; "
        "means are weighted by area, the edge error by length."
    )
    sections = [note(words), Table.of(PatchRow, result.patches, PATCHES).html()]
    if result.compare:
        sections += [heading("Compared"), Table.of(ComparedRow, result.compare, COMPARED).html()]
    for part in laid:
        compared = stage / f"{stems[part]}_compared.png"
        worst: list[list[Cell]] = [
            [row.patch, ", ".join(map(str, face.channels)), face.value]
            for row in result.patches
            if row.part == part
            for face in row.worst
        ]
        sections += [
            heading(part),
            media(stage / f"{stems[part]}.png", f"{part}: flat map and body"),
            media(compared, f"{part}: the same charts compared") if compared.exists() else "",
            Table(["patch", "channels", metric.label], worst, "Worst triangles").html(),
        ]
    return page(f"{result.robot}: flat maps", sections)


def file_stems(parts: Iterable[str]) -> dict[str, str]:
    """By part, its name as that of files: of a mesh file without its suffix where that will do."""
    from skinmap.io.robots.mesh_file import MESH_SUFFIXES

    whole = {part: re.sub(r"[^\w.-]", "_", part) for part in parts}
    short = {
        part: name.removesuffix(Path(part).suffix) if Path(part).suffix in MESH_SUFFIXES else name
        for part, name in whole.items()
    }
    names, taken, found = list(short.values()), set[str](), {}
    for part, one in short.items():
        numbered = (f"{whole[part]}_{number}" for number in count(2))
        for stem in chain([one] if names.count(one) == 1 else [], [whole[part]], numbered):
            # Some file systems do not tell capitals from small letters.
            own = {name.lower() for name in _files(part, stem)}
            if not own & taken:
                break
        taken |= own
        found[part] = stem
    return found


def _files(part: str, stem: str) -> tuple[str, str, str]:
    """Picture, mesh and comparison of a part."""
    # The OBJ of a mesh file that is one must not take its place.
    mesh = f"{stem}_flat.obj" if Path(part).suffix == ".obj" else f"{stem}.obj"
    return f"{stem}.png", mesh, f"{stem}_compared.png"


def _lines(result: FlattenResult) -> Iterator[str | Table]:
    shown = "part patch vertices holes method flips edge_rms_percent area_sd quasi_conformal.mean"
    yield Table.of(PatchRow, result.patches, f"{shown}=angle")
    for one in result.patches:
        yield from _words(one)
    if result.compare:
        shown = "part patch with_ flips edge_rms_percent area_sd"
        yield Table.of(ComparedRow, result.compare, shown)
    yield from result.sheets


def _words(one: PatchRow) -> Iterator[str]:
    """On the seam of a patch, where there is something to say."""
    from skinmap.flat.flat_map import STRETCHING as FREE

    name = f"{one.part}, patch {one.patch}"
    own, shortest = one.touches_divided, one.touches_divided_shortest
    if one.period_mm is not None:
        yield f"{name}: a tube laid flat uncut, the map repeats itself after {one.period_mm:.1f} mm"
    off = LONG[0] < one.edge_rms_percent <= LONG[1]
    if off and one.period_mm is None and one.method not in FREE:
        yield (
            f"{name}: lengths are {one.edge_rms_percent:.0f} % off (rms): --max-distortion "
            f"{SLIT:g} slits it further, --seam FILE cuts where you choose"
        )
    if one.touches:
        said = f"{name}: {own} of {one.touches} touches divided, {shortest} by the shortest seam"
        if own == shortest and shortest:
            said += (
                ", which stays: touches are spread so evenly that no other divides fewer new ones"
            )
        elif (saved := one.touches_saved_percent) is not None:
            said += f"; of touches not used for choosing {saved:.0f} % are saved"
        yield said
