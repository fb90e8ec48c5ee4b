"""`skinmap export`: taxels and recordings in the formats of others."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from skinmap.commands import options
from skinmap.commands.progress import progress
from skinmap.errors import (
    KINDS,
    DataFormatError,
    MissingFileError,
    OutputError,
    SkinError,
    UnknownNameError,
    warn,
)
from skinmap.imports import import_optional
from skinmap.io.output import staged_file, staged_folder
from skinmap.report.present import present

if TYPE_CHECKING:
    from skinmap.io.recordings.recorded_stream import Kind, RecordedStream, StreamInfo
    from skinmap.io.taxels.cyskin import CySkin
    from skinmap.live.loop import TouchLoop
    from skinmap.live.sources.playback import MarkedSpan
    from skinmap.skin.taxels import TaxelTable

TAXELS = ("csv", "icub", "urdf", "cyskin", "mjcf")
FOLDERS = ("lerobot", "rosbag2")  # of a recording
NAMED = ("contacts", "rrd")  # of a recording whose touches a model names
ENDINGS = {  # of the files of a format
    "csv": (".csv",), "icub": (".txt",), "urdf": (".urdf", ".xml"), "cyskin": (".json",),
    "mjcf": (".xml",), "touched": (".csv",), "rrd": (".rrd",), "contacts": (".csv", ".parquet"),
}  # fmt: skip
WRITERS = {".h5": "write_hdf5", ".hdf5": "write_hdf5", ".npz": "write_npz"}
WRITTEN = (".mcap", *WRITERS)  # endings that only recordings are written in
MCAP = ".mcap"


@dataclass(frozen=True, kw_only=True, slots=True)
class Exported:
    """What was written.

    Attributes
    ----------
    robot
        Name of the robot.
    format
        Format of the output.
    files
        Name of the file, or of the folder.
    """

    robot: str
    format: str
    files: list[str]


@dataclass(frozen=True, kw_only=True, slots=True)
class ExportedSkin:
    """A skin in a model of the whole robot.

    Attributes
    ----------
    name, link
        The part, and the link that carries it.
    taxels
        Total number of taxels.
    """

    name: str
    link: str
    taxels: int


@dataclass(frozen=True, kw_only=True, slots=True)
class ExportedPart(ExportedSkin):
    """The part that was written.

    Attributes
    ----------
    name
        Of the part, or of the bare table.
    link
        Link in whose frame the taxels are; empty for a bare table without one.
    channels
        Length of its live vector.
    modules
        Total number of modules.
    """

    channels: int
    modules: int


@dataclass(frozen=True, kw_only=True, slots=True)
class ExportedTaxels(Exported):
    """Taxels that were written.

    Attributes
    ----------
    robot
        Its name, or that of the bare table.
    parts
        The part that was exported.
    """

    parts: list[ExportedPart]


@dataclass(frozen=True, kw_only=True, slots=True)
class ExportedModel(Exported):
    """A whole robot that was written.

    Attributes
    ----------
    links
        Number of the robot's links.
    joints
        Number of joints that move.
    without_mass
        Moving links without a mass, which received 20 g.
    without_mesh
        Number of links without a mesh of any volume, which nothing can touch.
    unreadable
        Links whose mesh cannot be read, and why; nothing bumps into them either.
    parts
        Skins of the parts.
    """

    format: Literal["mjcf"]
    links: int
    joints: int
    without_mass: list[str]
    without_mesh: int
    unreadable: list[str]
    parts: list[ExportedSkin]


@dataclass(frozen=True, kw_only=True, slots=True)
class ChannelsOfPart:
    """A part that was recorded.

    Attributes
    ----------
    name, channels
        The part, and how many values of a sample are its.
    """

    name: str
    channels: int


@dataclass(frozen=True, kw_only=True, slots=True)
class ExportedRecording(Exported):
    """A recording that was written in another format.

    Attributes
    ----------
    robot
        Name of the recorded robot; empty where the file has none.
    kind
        Kind of the values, raw or pressure.
    samples
        Total number of samples.
    parts
        In the order of the channels.
    """

    kind: Literal["raw", "pressure"]
    samples: int
    parts: list[ChannelsOfPart]


@dataclass(frozen=True, kw_only=True, slots=True)
class TouchedRow:
    """Touches of one part over all recordings.

    Attributes
    ----------
    name
        Name of the part.
    taxels
        Number of taxels touched at least once.
    of
        Number of taxels of the part.
    most
        Touches of the taxel that was touched most.
    dwell_s
        Longest time that a taxel was touched, all touches together [s].
    largest
        Largest pressure while touched [counts].
    """

    name: str
    taxels: int
    of: int
    most: int
    dwell_s: float
    largest: float


@dataclass(frozen=True, kw_only=True, slots=True)
class ExportedTouched(Exported):
    """Touched places of a robot over recordings.

    Attributes
    ----------
    recordings
        Their names, in the order in which they were read.
    seconds
        Duration of all recordings.
    parts
        Those that were recorded.
    files
        The table: a line for each taxel.
    """

    format: Literal["touched"]
    recordings: list[str]
    seconds: float
    parts: list[TouchedRow]


@dataclass(frozen=True, kw_only=True, slots=True)
class ExportedImages(Exported):
    """Contact images of the touches of a recording.

    Attributes
    ----------
    images
        Number of images, one for each marked touch.
    rows
        Height of an image in pixels.
    columns
        Width of an image in pixels.
    labels
        Number of images by label.
    without_touch
        Marked touches in which no taxel is pressed; they have no image.
    files
        The folder: `images.npz` with all of them, and one picture for each.
    """

    format: Literal["images"]
    images: int
    rows: int
    columns: int
    labels: dict[str, int]
    without_touch: int


@click.command("export")
@options.robot_argument
@options.part_option
@click.option(
    "--format", "format",
    type=click.Choice([*TAXELS, *FOLDERS, *NAMED, "images", "touched"]),
    help="Format of the output.  [default: csv for taxels]",
)  # fmt: skip
@options.out_file("File to write, or folder of a format.", required=True, folder=True)
@options.calibration_option
@options.prints(ExportedTaxels, ExportedModel, ExportedRecording, ExportedTouched, ExportedImages)
def command(
    robot: str,
    parts: tuple[str, ...],
    format: str | None,
    output: Path,
    calibrations: tuple[str, ...],
    as_json: bool,
) -> None:
    """Write the taxels of a part: csv, icub (positions .txt), urdf (tactile extension).

    cyskin is a .json of CySkin with the surface mesh and the flat map of the part.
    mjcf is the whole robot with its skins as tactile sensors, a model for MuJoCo.

    ROBOT is a built-in name (default: icub), the path of a manifest, or a bare taxel table. The
    taxels of a robot are repaired and in the frame of their link, those of a bare table as they
    are; FORMAT:FILE reads one whose suffix does not tell its format.

    A recording (.mcap, .npz, .xdf, data.log) in place of the robot is written as arrays for
    machine learning: HDF5 or NPZ, by the suffix of the output. A cut or damaged .mcap is written
    whole again, for all MCAP readers, with -o *.mcap. Folders are written with --format lerobot
    (a LeRobot data set) or rosbag2 (with a cloud of the taxels for every sample).

    With --format images each marked touch becomes a contact image as published, 66 x 100 pixels of
    8 bits, of the moment halfway: PNG files and images.npz in a folder.

    With --format rrd a recording becomes a file of rerun (extra rerun): body, taxels, touches with
    their names, plots. With --format touched a recording, or a folder of some, becomes a table
    (.csv) of where the robot was touched: count, dwell, largest pressure and last time of each
    taxel. With --format contacts a recording becomes a table (.csv, .parquet) with a row for each
    touch and sample: place, area, names, and with --calibration force and pressures; `marked` is
    the label that the recording itself has there.

    \b
    Example:  skinmap export icub --part torso --format icub -o torso.txt
    Example:  skinmap export icub --format mjcf -o icub.xml
    Example:  skinmap export torso.txt --format csv -o torso.csv
    Example:  skinmap export touch.mcap -o touch.h5
    Example:  skinmap export cut.mcap -o whole.mcap
    Example:  skinmap export touch.mcap --format lerobot -o dataset
    Example:  skinmap export touch.mcap --format images -o folder
    Example:  skinmap export touch.mcap --format rrd -o touch.rrd
    Example:  skinmap export touch.mcap --format contacts -o contacts.csv
    Example:  skinmap export recordings --format touched -o touched.csv
    """
    if calibrations and format != "contacts":
        raise click.UsageError("--calibration needs --format contacts")
    _refuse_source(output, Path(robot))
    from skinmap.io.recordings.touch_files import is_foreign

    written = format in (*NAMED, *FOLDERS) or output.suffix.lower() in WRITTEN
    recorded = _is_recording(Path(robot)) or (written and is_foreign(Path(robot)))
    if format in (*NAMED, *FOLDERS) and not recorded:
        raise click.UsageError(f"{format} is for recordings, and {robot} is not one")
    result: Exported
    if recorded and (format not in EXPORTS or format in TAXELS):
        if format in TAXELS or parts:
            raise click.UsageError(
                f"a recording is written whole, in the format that -o ends in, or with --format "
                f"{', '.join(FOLDERS)}"
            )
        result = export_recording(Path(robot), output, format)
    elif format in EXPORTS:
        if format != "images":
            _check_ending(output, format)
        result = EXPORTS[format](robot, parts, output, calibrations)
    else:
        result = export_taxels(robot, parts, output, format or "csv")
    present(result, _lines, as_json=as_json)


def _refuse_source(output: Path, given: Path) -> None:
    """Refuse to write over what is read: a recording or a table, a manifest and the files it names.

    Raises
    ------
    OutputError
        One of these is the output, even with --force.
    """
    if output.is_file() and given.is_file():
        named = given.suffix == ".toml" and f'{output.name}"' in given.read_text(errors="replace")
        if output.samefile(given) or (named and given.resolve().parent in output.resolve().parents):
            raise OutputError(f"cannot write {str(output)!r}: it is read; name a new file")


def _check_ending(output: Path, format: str) -> None:
    """Refuse a name that would pass a file off as something else, such as a recording."""
    endings = ENDINGS[format]
    if output.suffix.lower() not in endings:
        raise click.UsageError(
            f"{format} is written to files ending in {' or '.join(endings)}, got {output.name!r}"
        )


def _is_recording(path: Path) -> bool:
    from skinmap.io.ros2.bag import is_bag

    known = path.suffix.lower() in KINDS["a recording"] or (path / "data.log").exists()
    return known or is_bag(path)


def export_taxels(source: str, parts: tuple[str, ...], output: Path, format: str) -> ExportedTaxels:
    """Write the taxels of a part, or of a bare table."""
    robot, part, table = _table(source, parts)
    _check_ending(output, format)
    with staged_file(output) as stage:
        _write(table, stage, format, robot, part)
    row = ExportedPart(
        name=part,
        link=table.link,
        channels=int(table.channels[-1]) + 1,
        taxels=len(table),
        modules=len(set(table.modules.tolist())),
    )
    return ExportedTaxels(robot=robot, format=format, parts=[row], files=[str(output)])


def export_model(robot: str, parts: tuple[str, ...], output: Path, _: Any) -> ExportedModel:
    """Write a whole robot with its skins, or those of some parts."""
    from skinmap.io.robots.mjcf import write_mjcf

    loaded, names = options.open_robot(robot, parts)
    with staged_file(output) as stage:
        report = write_mjcf(loaded, stage, parts=names)
    return ExportedModel(
        robot=loaded.name,
        format="mjcf",
        links=report.links,
        joints=report.joints,
        without_mass=report.without_mass,
        without_mesh=len(report.without_mesh),
        unreadable=report.unreadable,
        parts=[
            ExportedSkin(name=name, link=loaded.part(name).link, taxels=count)
            for name, count in report.taxels.items()
        ],
        files=[str(output)],
    )


def export_touched(source: str, parts: tuple[str, ...], output: Path, _: Any) -> ExportedTouched:
    """Write where the parts of a robot were touched in a recording, or in those of a folder."""
    from skinmap.live.sources.open_source import open_recording
    from skinmap.live.touched_taxels import recordings_of, robot_of, touched_in
    from skinmap.touch.prepared_skin import PreparedSkin

    path = Path(source)
    if not path.exists():
        raise MissingFileError(path, "a recording, or a folder of some")
    paths = recordings_of(path)
    robot, names = options.open_robot(robot_of(paths) or "icub", parts)
    skins = {part: PreparedSkin(robot.skin(part)) for part in names}
    opened = partial(open_recording, robot=robot, speed=float("inf"))
    with progress(len(paths), "touched") as advance:
        found = touched_in(paths, robot, skins, opened, progress=advance)
    with staged_file(output) as stage:
        stage.write_text(found.csv(), encoding="utf-8")
    return ExportedTouched(
        robot=robot.name,
        format="touched",
        recordings=found.recordings,
        seconds=found.seconds,
        parts=[
            TouchedRow(
                name=part,
                taxels=int((one.count > 0).sum()),
                of=len(one.count),
                most=int(one.count.max(initial=0)),
                dwell_s=float(one.dwell.max(initial=0.0)),
                largest=float(one.largest.max(initial=0.0)),
            )
            for part, one in found.parts.items()
        ],
        files=[str(output)],
    )


def export_images(source: str, parts: tuple[str, ...], output: Path, _: Any) -> ExportedImages:
    """Write the contact image of each marked touch of a recording."""
    from collections import Counter

    import numpy as np

    from skinmap.cli.collection import collect
    from skinmap.io.recordings.image_files import LabelledImages, write_images
    from skinmap.touch.contacts.skin_geometry import pressed
    from skinmap.touch.images.contact_image import SIZE, paper_images

    _check_new(output)
    path = Path(source)
    found = collect([path], None, parts)
    held = [(one, pressed(one.touch.samples)) for one in found.touches]
    halfway = [(one, own[len(own) // 2][None]) for one, own in held if len(own)]
    kept = [one for one, _ in halfway]
    if not kept:
        raise DataFormatError("no touch is marked in it; `skinmap label` marks touches", path)
    every = LabelledImages(
        np.stack([paper_images(one.touch.skin.image_geometry, own)[0] for one, own in halfway]),
        np.array([one.touch.label for one in kept]),
        np.arange(len(kept)),
        np.array([one.part for one in kept]),
    )
    with staged_folder(output) as stage:
        write_images(every, stage)
    return ExportedImages(
        robot=kept[0].robot,
        format="images",
        images=len(kept),
        rows=SIZE[0],
        columns=SIZE[1],
        labels=dict(sorted(Counter(map(str, every.labels)).items())),
        without_touch=len(found.touches) - len(kept),
        files=[str(output)],
    )


@contextmanager
def _naming(
    path: Path, parts: tuple[str, ...], calibrations: tuple[str, ...] = ()
) -> Iterator[tuple[TouchLoop, list[MarkedSpan]]]:
    """A recording whose touches are named by the model of Skinmap, its rest learnt ahead.

    Beside it the marks of the recording itself.
    """
    from skinmap.live.loop import TouchLoop
    from skinmap.live.response.loads import load_calibrations
    from skinmap.live.sources.open_source import open_recording
    from skinmap.live.touched_taxels import robot_of
    from skinmap.recognition.named_classifiers import default_model
    from skinmap.touch.prepared_skin import PreparedSkin

    robot, names = options.open_robot(robot_of([path]) or "icub", parts)
    source = open_recording(path, robot=robot, speed=float("inf"))
    shared = [part for part in source.info.parts if part in names]
    if not shared:
        source.close()
        raise click.UsageError(f"{path} holds {', '.join(source.info.parts)}, no part asked for")
    skins = {part: PreparedSkin(robot.skin(part)) for part in shared}
    loads = load_calibrations(calibrations, skins) if calibrations else None
    loop = TouchLoop(
        robot, source, classifier=default_model(), parts=shared, skins=skins, calibrations=loads,
        singly=True,
    )  # fmt: skip
    with closing(loop):
        loop.learn_rest(open_recording(path, robot=robot, speed=float("inf")))
        yield loop, source.marked()


def export_rerun(source: str, parts: tuple[str, ...], output: Path, _: Any) -> ExportedRecording:
    """Write a recording as a file of rerun, its touches named by the model of Skinmap."""
    from skinmap.live.moment_files import NEED, write_rerun

    import_optional("rerun", NEED)  # before any work is done
    path = Path(source)
    with _naming(path, parts) as (loop, marked), staged_file(output) as stage:
        skins = {part: one.skin for part, one in loop.skins.items()}
        samples = write_rerun(loop, loop.robot, skins, stage, name=path.name, marked=marked)
    return _recording(loop.dense_info(), loop.info.kind, samples, "rrd", output)


def export_contacts(
    source: str, parts: tuple[str, ...], output: Path, calibrations: tuple[str, ...]
) -> ExportedRecording:
    """Write the touches of a recording as a table, a row for each touch and sample."""
    from skinmap.live.moment_files import NEED_ARROW, write_contacts

    parquet = output.suffix.lower() == ".parquet"
    if parquet:
        import_optional("pyarrow", NEED_ARROW)  # before any work is done
    named = _naming(Path(source), parts, calibrations)
    with named as (loop, marked), staged_file(output) as stage:
        write_contacts(loop, loop.robot, stage, parquet=parquet, marked=marked)
    return _recording(loop.dense_info(), loop.info.kind, loop.counts.used, "contacts", output)


def _recording(
    info: StreamInfo, kind: Kind, samples: int, format: str, output: Path
) -> ExportedRecording:
    return ExportedRecording(
        robot=info.robot,
        format=format,
        kind=kind,
        samples=samples,
        parts=[
            ChannelsOfPart(name=part, channels=width)
            for part, width in zip(info.parts, info.widths, strict=True)
        ],
        files=[str(output)],
    )


def export_recording(path: Path, output: Path, format: str | None = None) -> ExportedRecording:
    """Write a recording as arrays, a data set, a bag, or an MCAP that is whole again."""
    from skinmap.io.mcap.reading import write_repaired
    from skinmap.io.recordings import learning
    from skinmap.io.ros2.bag import mapping_of
    from skinmap.live.sources.open_source import open_track

    suffix = output.suffix.lower()
    mends = path.suffix.lower() == MCAP and not mapping_of(path).is_file()
    if format is not None:
        if suffix in (*KINDS["a recording"], *WRITERS):
            name = output.name
            raise click.UsageError(f"{format} is a folder, {name!r} is the name of a file")
        track = _with_taxels(open_track(path))
        _write_folder(track, output, format)
    elif suffix == MCAP and mends:
        with staged_file(output) as stage:
            track = write_repaired(path, stage)
    elif suffix in WRITERS:
        track = _with_taxels(open_track(path))
        with staged_file(output) as stage:
            getattr(learning, WRITERS[suffix])(track, stage)
    else:
        formats = [*WRITERS, *([MCAP] if mends else [])]
        raise UnknownNameError("format of a recording for files ending in", suffix, formats)
    return _recording(track.info, track.kind, len(track.times), format or suffix[1:], output)


def _with_taxels(track: RecordedStream) -> RecordedStream:
    """A recording without tables, with those of the robot that a mapping or our file names."""
    from skinmap.skin.skin import fingerprint
    from skinmap.skin.taxels import TaxelTable

    if track.tables or not track.manifest:
        return track
    try:
        robot = options.named_robot(track.manifest)
    except SkinError as error:
        warn(f"written without its taxels: {error}")
        return track
    found = {}
    for part, width in zip(track.parts, track.info.widths, strict=True):
        if part not in robot.parts:
            continue
        skin = robot.skin(part)
        same = track.info.fingerprints.get(part) in (None, fingerprint(skin))
        if same and (len(skin) == width or skin.channels.max() < width):
            found[part] = TaxelTable(
                skin.channels, skin.modules, skin.positions, skin.normals, link=skin.link
            )
    return dataclasses.replace(track, tables=found)


def _write_folder(track: RecordedStream, output: Path, format: str) -> None:
    """Write a folder that is not there yet: readers take all files in it for theirs."""
    if format == "lerobot":
        from skinmap.io.recordings.learning import write_lerobot as write
    else:
        from skinmap.io.ros2.bag import write_rosbag2 as write
    _check_new(output)
    with staged_folder(output) as stage:
        write(track, stage)


def _check_new(folder: Path) -> None:

    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise OutputError(f"{str(folder)!r} is there already; name a folder that is not")


EXPORTS: dict[str, Callable[..., Exported]] = {
    "touched": export_touched, "images": export_images, "rrd": export_rerun,
    "contacts": export_contacts, "mjcf": export_model,
}  # fmt: skip


def _lines(result: Exported) -> Iterator[str]:
    if isinstance(result, ExportedTouched):
        count = len(result.recordings)
        yield f"{count} recording{'s' * (count > 1)}, {result.seconds:,.1f} s of samples"
        for row in result.parts:
            yield (
                f"{row.name}: {row.taxels} of {row.of} taxels touched, one {row.most} times, "
                f"{row.dwell_s:.1f} s at longest, {row.largest:.0f} counts at most"
            )
    elif isinstance(result, ExportedImages):
        counted = ", ".join(f"{count} {label}" for label, count in result.labels.items())
        yield f"{result.images} images of {result.rows} x {result.columns}: {counted}"
    elif isinstance(result, ExportedTaxels):
        for part in result.parts:
            yield f"{part.name}: {part.taxels} taxels, {part.modules} modules"
    elif isinstance(result, ExportedModel):
        taxels = sum(skin.taxels for skin in result.parts)
        yield (
            f"{result.robot}: {result.links} links, {result.joints} joints, "
            f"{len(result.parts)} skins of {taxels} taxels"
        )
        if result.without_mass:
            yield f"given a mass of 20 g, since they have none: {', '.join(result.without_mass)}"
        yield from (f"without its mesh: {one}" for one in result.unreadable)
    elif isinstance(result, ExportedRecording):
        channels = sum(part.channels for part in result.parts)
        yield f"{result.samples} samples of {result.kind} values, {channels} channels"


def _table(robot: str, parts: tuple[str, ...]) -> tuple[str, str, TaxelTable]:
    """Names of the robot and the part, and the taxels."""
    from skinmap.io.taxels.taxel_table import SUFFIXES, read_taxels, readers

    read_as, colon, file = robot.partition(":")
    if not colon or read_as not in readers.names():
        read_as, file = "", robot
    path = Path(file)
    if read_as or path.suffix.lower() in SUFFIXES:
        if parts:
            raise click.UsageError(f"--part is for a robot; {robot} is a bare table")
        return path.stem, path.stem, read_taxels(path, read_as or None)
    loaded, names = options.open_robot(robot, parts)
    if len(names) > 1:
        raise click.UsageError(f"a file holds one part, --part chooses it: {', '.join(names)}")
    (name,) = names
    link = loaded.part(name).link
    skin = loaded.skin(name)
    table = dataclasses.replace(
        loaded.repair(name).table, positions=skin.positions, normals=skin.normals, link=link
    )
    return loaded.name, name, table


def _with_map(table: TaxelTable, part: str) -> CySkin:
    """A table with its surface mesh and its flat map, as CySkin files have them.

    Raises
    ------
    InvalidMeshError
        Taxels that make no surface.
    OutputError
        A taxel in no triangle.
    """
    import numpy as np

    from skinmap.flat.flat_map import flatten
    from skinmap.io.taxels.cyskin import CySkin, ParentFrame, TactileMap, ids_of
    from skinmap.skin.skin import skin_from_table
    from skinmap.surface.surface_mesh import build_surface

    skin = skin_from_table(table, None, part, table.link, keep_normals=bool(table.normals.any()))
    mesh = build_surface(skin)
    flat = flatten(mesh)
    lost = int(np.isnan(flat.uv).any(axis=1).sum())
    if lost:
        raise OutputError(f"{part!r}: {lost} taxels lie in no triangle and have no place on a map")
    ids = ids_of(table)
    ours = TactileMap(f"{part}_{flat.charts[0].method}", "flat_mesh", ids, flat.uv, mesh.faces)
    frame = ParentFrame(table.link, np.eye(4))
    return CySkin(part, ids, skin.positions, skin.normals, mesh.faces, (ours,), (frame,))


def _write(table: TaxelTable, path: Path, format: str, robot: str, part: str) -> None:
    from skinmap.io.taxels import icub, tactile_urdf
    from skinmap.io.taxels.taxel_table import write_csv

    if format == "urdf":
        tactile_urdf.write_tactile_urdf({part: table}, path, robot=robot)
    elif format == "cyskin":
        from skinmap.io.taxels.cyskin import write_cyskin

        write_cyskin(_with_map(table, part), path)
    elif format == "icub":
        if not table.modules.any():  # a file that names none
            table = dataclasses.replace(table, modules=table.channels // icub.CHANNELS_PER_MODULE)
        icub.write_icub(table, path, name=table.link or "_".join(part.split()))
    else:
        write_csv(table, path)
