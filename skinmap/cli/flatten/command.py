"""`skinmap flatten`: flat maps of the skin and what they distort."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinmap.cli.flatten.result import FlattenResult, PatchRow, Spread
from skinmap.commands.options import (
    MAX_SECONDS,
    Number,
    open_robot,
    out_folder,
    outside_option,
    part_option,
    prints,
    seed_option,
)
from skinmap.commands.profiles import profile_option
from skinmap.commands.progress import progress
from skinmap.commands.workers import worker_options, workers_options
from skinmap.report.image import image, media
from skinmap.report.page import heading, note, page
from skinmap.report.present import present
from skinmap.report.result import given
from skinmap.report.table import Cell, Table

if TYPE_CHECKING:
    from skinmap.cli.flatten.job import Flattened, Surfaces

ISOMETRY = 4.0  # as `skinmap.flat.flat_map` has it; a test compares
MESHES = (".stl", ".obj", ".ply", ".off", ".dae", ".glb", ".gltf", ".3mf")
CYSKIN = (".json",)
SEAM_HELP = "Channels that seams keep away from, as 3,8,20-31; may be repeated."
COMPARE_HELP = (
    "Methods to compare with, `drawing` for a hand-drawn map, `theirs` for the file's own."
)

SEAM_KINDS = (
    "Where what is no disc is cut: contacts RECORDING (where its touches are divided least), "
    "shortest, a file of channels, or none (tubes: a map that repeats itself).  [default: shortest]"
)
BOUND_HELP = "Slit each chart until its mean symmetric Dirichlet energy is below this, as 4.1."
SHEETS_HELP = "Take mesh files with three faces at an edge apart into sheets there."


class SeamOption(click.Option):
    """An option of one word, or of two where the first is `contacts`."""

    def add_to_parser(self, parser: Any, ctx: click.Context) -> None:
        """Let the word after `contacts` belong to it."""
        super().add_to_parser(parser, ctx)
        for name in self.opts:
            own = parser._long_opt[name]
            plain = own.process

            def process(value: str, state: Any, plain: Any = plain) -> None:
                if value == "contacts":
                    if not state.rargs:
                        raise click.UsageError("--seam contacts needs a recording after it")
                    value = f"contacts {state.rargs.pop(0)}"
                plain(value, state)

            own.process = process


@click.command("flatten")
@click.argument("robots", nargs=-1, metavar="[ROBOT|MESH...]")
@outside_option
@part_option
@click.option(
    "--method",
    metavar="METHOD",
    help="Flattening method; balanced, or auto where a budget is given.",
)
@click.option(
    "--max-seconds",
    type=Number(0.0, MAX_SECONDS, min_open=True),
    help="CPU time for the maps of a part [s], for auto.",
)
@click.option(
    "--max-edge-rms",
    type=Number(0.0, 1000.0, min_open=True),
    help="Edge error to reach [%], for auto.",
)
@click.option(
    "--meshing",
    metavar="METHOD",
    help="Surface meshing method.  [default: consensus; the faces of a .json]",
)
@click.option(
    "--iterations", type=click.IntRange(1, 100_000), help="Of arap, balanced, slim or dirichlet."
)
@click.option(
    "--precision",
    type=click.Choice(["float64", "float32"]),
    default="float64",
    show_default=True,
    help="Of the sparse solves; float32 needs half the memory.",
)
@click.option("--compare", default="", metavar="M2,M3|drawing|theirs", help=COMPARE_HELP)
@click.option(
    "--drawing",
    type=click.Path(path_type=Path),
    help="Drawing of the part: iCubSkinGui .ini, CySkin .json.",
)
@click.option(
    "--metric",
    metavar="METRIC",
    default="edge_strain",
    show_default=True,
    help="What colours the maps.",
)
@click.option(
    "--scale",
    type=click.Choice(["own", "fixed"]),
    default="own",
    show_default=True,
    help="Of the colours: the map's own range, or fixed, to compare maps.",
)
@click.option("--seam-away", multiple=True, metavar="CHANNELS", help=SEAM_HELP)
@click.option("--seam", cls=SeamOption, default="shortest", metavar="SEAM", help=SEAM_KINDS)
@click.option("--max-distortion", type=Number(ISOMETRY, 1e6, min_open=True), help=BOUND_HELP)
@click.option("--split-sheets", is_flag=True, help=SHEETS_HELP)
@out_folder("pictures, OBJ and VTP with texture coordinates, and report.html")
@workers_options
@seed_option
@profile_option("flatten")
@prints(FlattenResult)
def command(
    robots: tuple[str, ...],
    parts: tuple[str, ...],
    out: Path | None,
    as_json: bool,
    split_sheets: bool,
    **options: Any,
) -> None:
    """Lay every patch of a robot's skin, or any triangle mesh, flat and measure the distortion.

    ROBOT is a built-in name (default: icub), the path of a manifest, or one or several mesh files
    (OBJ, STL, PLY, OFF, ...) or CySkin files (.json), whose own faces are taken.
    Methods are tutte, harmonic, lscm, bff, arap, slim, dirichlet, or by
    price fast, balanced, accurate, auto; meshing is consensus, fast or accurate. Triangles are
    coloured by edge_strain, area, quasi_conformal, symmetric_dirichlet, stretch_l2 or arap_energy.

    \b
    Example:  skinmap flatten icub --part torso --out maps
              skinmap flatten icub --part left_arm --compare bff,lscm --json
              skinmap flatten bunny.obj --method accurate --json
              skinmap flatten skin.json --compare theirs
              skinmap flatten sleeve.toml --seam contacts touches.npz --out maps
              skinmap flatten scans/*.stl --jobs 4 --resume scans.resume --json
    """
    from skinmap.cli.flatten.job import work
    from skinmap.cli.flatten.options import checked_options

    spread = worker_options(options)
    asked = checked_options(**options)
    surfaces = _surfaces(robots or ("icub",), parts, asked.meshing, split_sheets)
    title = "flatten"
    with spread.open(title) as workers, progress(len(surfaces.makers), title) as advance:
        found = work(asked, surfaces, workers=workers, progress=advance)
    with progress(len(found.maps) if out else 0, "drawing") as advance:
        present(
            found.result,
            _lines,
            as_json=as_json,
            out=out,
            write=lambda stage: write_files(found, stage, advance),
            page=lambda stage: report_page(found, stage),
        )


def _surfaces(
    robots: tuple[str, ...], parts: tuple[str, ...], meshing: str | None, split_sheets: bool
) -> Surfaces:
    """What the arguments name: mesh files, CySkin files, or parts of one robot."""
    from skinmap.cli.flatten.job import file_surfaces, mesh_surfaces, robot_surfaces
    from skinmap.errors import UnknownNameError
    from skinmap.surface.surface_mesh import DEFAULT

    paths = [Path(robot) for robot in robots]
    for suffixes in (MESHES, CYSKIN):
        if all(path.suffix.lower() in suffixes for path in paths):
            if parts:
                raise UnknownNameError("part", parts[0], ())
            own = list(dict.fromkeys(paths))
            if suffixes is MESHES:
                return mesh_surfaces(own, split_sheets=split_sheets)
            return file_surfaces(own, meshing)
    if split_sheets:
        raise click.UsageError("--split-sheets is for mesh files; a robot's skin has no such edges")
    if len(robots) > 1:
        raise click.UsageError(
            "several mesh files, several CySkin files, or one robot: not " + " ".join(robots)[:200]
        )
    return robot_surfaces(*open_robot(robots[0], parts), meshing or DEFAULT)


def _words(row: PatchRow) -> Iterator[str]:
    """On the seam of a patch, where there is something to say."""
    name = f"{row.part}, patch {row.patch}"
    if row.period_mm is not None:
        yield f"{name}: a tube laid flat uncut, the map repeats itself after {row.period_mm:.1f} mm"
    if row.touches and row.touches_divided_shortest is not None and row.touches_divided is not None:
        shortest, own = row.touches_divided_shortest, row.touches_divided
        said = f"{own} of {row.touches} touches divided, {shortest} by the shortest seam"
        if own == shortest and shortest:
            said += (
                ", which stays: touches are spread so evenly that no other divides fewer new ones"
            )
        elif row.touches_saved_percent is not None:
            said += (
                f"; of touches not used for choosing {row.touches_saved_percent:.0f} % are saved"
            )
        yield f"{name}: {said}"


def _lines(result: FlattenResult) -> Iterator[str | Table]:
    columns = ["part", "patch", "vertices", "holes", "method", "flips", "edge rms %", "area sd"]
    rows: list[list[Cell]] = [
        [
            row.part, row.patch, row.vertices, row.holes, row.method, row.flips,
            row.edge_rms_percent, row.area_sd, row.quasi_conformal.mean,
        ]
        for row in result.patches
    ]  # fmt: skip
    yield Table([*columns, "angle"], rows)
    for row in result.patches:
        yield from _words(row)
    if result.compare:
        rows = [
            [row.part, row.patch, row.with_, row.flips, row.edge_rms_percent, row.area_sd]
            for row in result.compare
        ]
        yield Table(["part", "patch", "compared with", *columns[5:]], rows)


def write_files(found: Flattened, stage: Path, advance: Callable[[str], None]) -> Iterator[str]:
    """Write a picture and the meshes of each part into a folder; the names."""
    from skinmap.cli.flatten.figures import comparison_figure, part_figure
    from skinmap.cli.flatten.options import FIXED
    from skinmap.flat.face_metrics import face_metric
    from skinmap.io.flat_maps.surface_files import write_flat_obj, write_flat_vtp

    metric = face_metric(found.result.metric)
    stems = file_stems(tuple(found.maps))
    for part, flat in found.maps.items():
        advance(part)
        stem = stems[part]
        picture = part_figure(flat, metric, fixed=found.result.scale == FIXED)
        (stage / f"{stem}.png").write_bytes(picture)
        # The OBJ of a mesh file that is one must not take its place.
        mesh = f"{stem}_flat.obj" if Path(part).suffix == ".obj" else f"{stem}.obj"
        write_flat_obj(flat, stage / mesh)
        write_flat_vtp(flat, stage / f"{stem}.vtp")
        yield from (f"{stem}.png", mesh, f"{stem}.vtp")
        others, drawn = found.others.get(part, {}), found.drawn.get(part, {})
        if others or drawn:
            shown = [(found.result.method, flat), *others.items()]
            compared = comparison_figure(shown, drawn, metric, fixed=found.result.scale == FIXED)
            (stage / f"{stem}_compared.png").write_bytes(compared)
            yield f"{stem}_compared.png"


def report_page(found: Flattened, stage: Path) -> str:
    """The page, with the pictures that were written."""
    from skinmap.cli.flatten.figures import histogram_figure
    from skinmap.flat.face_metrics import face_metric

    result, metric = found.result, face_metric(found.result.metric)
    stems = file_stems(tuple(found.maps))
    sections = [
        note(
            f"Coloured by: {metric.label}. Distortion at the scale that keeps the whole area; "
            "means are weighted by area, the edge error by length."
        ),
        _patch_table(found).html(),
    ]
    if result.compare:
        sections += [heading("Compared"), _compare_table(found).html()]
    for part, flat in found.maps.items():
        stem = stems[part]
        worst: list[list[Cell]] = [
            [row.patch, ", ".join(map(str, face.channels)), face.value]
            for row in result.patches
            if row.part == part
            for face in row.worst
        ]
        compared = stage / f"{stem}_compared.png"
        sections += [
            heading(part),
            media(stage / f"{stem}.png", f"{part}: flat map and body"),
            media(compared, f"{part}: the same charts compared") if compared.exists() else "",
            image(histogram_figure(flat), f"{part}: histograms"),
            Table(["patch", "channels", metric.label], worst, "Worst triangles").html(),
        ]
    return page(f"{result.robot}: flat maps", sections)


def _patch_table(found: Flattened) -> Table:
    columns = ["part", "patch", "vertices", "faces", "holes", "cut [mm]", "method", "flips"]
    columns += ["quasi-conformal", "largest", "area sd", "symmetric Dirichlet", "largest"]
    columns += ["stretch L2", "edge rms [%]", "geodesic stress", "±", "seconds"]
    rows: list[list[Cell]] = [
        [
            row.part, row.patch, row.vertices, row.faces, row.holes, row.cut_mm, row.method,
            row.flips, *_ends(row.quasi_conformal), row.area_sd, *_ends(row.symmetric_dirichlet),
            row.stretch_l2, row.edge_rms_percent, row.geodesic_stress, row.geodesic_stress_error,
            row.seconds,
        ]
        for row in found.result.patches
    ]  # fmt: skip
    return Table(columns, rows)


def _compare_table(found: Flattened) -> Table:
    columns = ["part", "patch", "with", "taxels drawn", "flips", "quasi-conformal", "largest"]
    columns += ["area sd", "symmetric Dirichlet", "largest", "edge rms [%]", "apart [mm]"]
    rows: list[list[Cell]] = [
        [
            row.part, row.patch, row.with_, given(row.taxels), row.flips,
            *_ends(given(row.quasi_conformal)), row.area_sd,
            *_ends(given(row.symmetric_dirichlet)), row.edge_rms_percent,
            given(row.distance_mm), given(row.seconds),
        ]
        for row in found.result.compare
    ]  # fmt: skip
    return Table([*columns, "seconds"], rows)


def _ends(spread: Spread | None) -> tuple[float | None, float | None]:
    return (None, None) if spread is None else (spread.mean, spread.max)


def file_stems(parts: Sequence[str]) -> dict[str, str]:
    """By part, its name as that of files: of a mesh file without its suffix where that will do."""
    short = {part: _stem(part, cut=True) for part in parts}
    names = list(short.values())
    return {
        part: name if names.count(name) == 1 else _stem(part, cut=False)
        for part, name in short.items()
    }


def _stem(part: str, *, cut: bool) -> str:
    from skinmap.io.robots.mesh_file import MESH_SUFFIXES

    name = part[: -len(Path(part).suffix)] if cut and Path(part).suffix in MESH_SUFFIXES else part
    return "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in name)
