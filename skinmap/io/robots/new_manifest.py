"""A manifest for a URDF or a mesh and taxel tables: their units and links, and copies beside it."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray
from skinmap.errors import MissingFileError, OutputError, SkinError
from skinmap.geometry.proximity import closest_on_mesh, median_spacing
from skinmap.geometry.rigid import transform_points
from skinmap.geometry.triangles import TriangleMesh, face_normals
from skinmap.io.output import staged_folder
from skinmap.io.robots.mesh_file import MESH_SUFFIXES, file_metres
from skinmap.io.robots.urdf import MeshBody, UrdfBody, read_urdf
from skinmap.io.safe_xml import local_name
from skinmap.io.text import UNITS
from skinmap.skin.repair import PITCHES, STATED_PITCHES
from skinmap.skin.robot import DH_SUFFIX, Robot
from skinmap.skin.taxels import TaxelTable
from skinmap.surface.taxel_cloud import gaps_on_one_side

KNOWN_UNITS = ("m", "cm", "mm", "in")
SAMPLED = 300  # taxels that are laid on every link
MOST = 80.0  # percent of the taxels that have to lie on a link: the rest may stand over its edge
NEAR = 0.02  # a skin further off than this does not tell that it belongs there [m]
CLEARER, APART = 3.0, 2e-3  # the next best is this many times further off, and this far [m]
FITS = 0.1  # of the skin's size: a skin further off its mesh in the best units fits in none
SHARE = 0.01  # of the skin's size: a skin so near lies on the mesh, whatever the units of both


@dataclass(frozen=True, kw_only=True, slots=True)
class Candidate:
    """A unit and a link that a taxel table may be for.

    Attributes
    ----------
    part
        Name of the part.
    units
        Unit of the positions.
    link
        Link of the URDF.
    skin_mm
        Size of the skin in this unit, along the axes.
    pitch_mm
        Distance from a taxel to the next one on its side of a thin part, median.
    link_mm
        Size of the link's mesh along the axes; null where it has none that can be read.
    distance_mm
        Distance of the taxels from the mesh, median; null without a mesh.
    most_mm
        Four of five taxels are nearer to the mesh; null without a mesh.
    unread
        Why the mesh of the link cannot be read; empty where it can, or where there is none.
    """

    part: str
    units: str
    link: str
    skin_mm: list[float]
    pitch_mm: float
    link_mm: list[float] | None
    distance_mm: float | None
    most_mm: float | None
    unread: str = ""

    @property
    def plausible(self) -> bool:
        """Whether taxels are as far apart as those of robot skins."""
        low, high = PITCHES
        return low <= 1e-3 * self.pitch_mm <= high

    @property
    def lies(self) -> bool:
        """Whether the skin lies on the mesh, with a pitch that a stated unit is believed for."""
        low, high = STATED_PITCHES
        return self.relative <= SHARE and low <= 1e-3 * self.pitch_mm <= high

    @property
    def off(self) -> float:
        """How far most taxels are off the link [m]."""
        return np.inf if self.most_mm is None else 1e-3 * self.most_mm

    @property
    def relative(self) -> float:
        """How far most taxels are off the link, in sizes of the skin: small units gain nothing."""
        return 1e3 * self.off / max(float(np.linalg.norm(self.skin_mm)), 1e-9)


def candidates(
    part: str, table: TaxelTable, robot: Robot, units: Iterable[str], links: Iterable[str]
) -> list[Candidate]:
    """Every unit with every link, the nearest first; units of an odd pitch come last.

    Parameters
    ----------
    part : str
    table : TaxelTable
        Its positions as the file has them.
    robot : Robot
        Its body is asked alone.
    units, links : iterable of str
        Those that come into question.
    """
    positions = np.unique(table.positions, axis=0)
    pitch, step = median_spacing(positions), max(1, len(positions) // SAMPLED)
    rest = robot.body.poses({})
    found = []
    for link in links:
        mesh, unread = None, ""
        try:
            mesh = robot.mesh(link)
        except SkinError as error:  # of another link than the part's, perhaps
            unread = str(error)
        mesh = mesh if mesh is not None and len(mesh.faces) else None
        # As when a manifest without `frame` is read.
        frames = [frame for frame in (link, link + DH_SUFFIX) if frame in rest]
        moves = [np.linalg.inv(rest[link]) @ rest[frame] for frame in frames]
        for unit in units:
            off, apart = None, pitch * UNITS[unit]
            if mesh is not None:
                moved = [transform_points(T, positions * UNITS[unit]) for T in moves]
                laid = [closest_on_mesh(one[::step], mesh.vertices, mesh.faces)[0] for one in moved]
                best = int(np.argmin([np.median(one) for one in laid]))
                off = laid[best]
                if np.percentile(off, MOST) < apart:
                    apart = _pitch(moved[best], mesh)
            found.append(
                Candidate(
                    part=part,
                    units=unit,
                    link=link,
                    skin_mm=(1e3 * (np.ptp(positions, axis=0) * UNITS[unit])).tolist(),
                    pitch_mm=1e3 * apart,
                    link_mm=None if mesh is None else (1e3 * np.ptp(mesh.vertices, 0)).tolist(),
                    distance_mm=None if off is None else 1e3 * float(np.median(off)),
                    most_mm=None if off is None else 1e3 * float(np.percentile(off, MOST)),
                    unread=unread,
                )
            )
    # A dense skin that lies on a link beats other units in which it would be far off.
    far = not any(one.plausible and one.off <= NEAR for one in found)
    return sorted(found, key=lambda one: (not (one.plausible or (far and one.lies)), one.off))


def _pitch(positions: FloatArray, mesh: TriangleMesh) -> float:
    """Median distance of taxels (n, 3) on a mesh to the next on their side of a thin part [m]."""
    face = closest_on_mesh(positions, mesh.vertices, mesh.faces)[1]
    normals = face_normals(mesh.vertices, mesh.faces)[face]
    return float(np.median(gaps_on_one_side(positions, normals)))


def mesh_units(
    mesh: Path, tables: Mapping[str, TaxelTable], units: str | None
) -> dict[str, list[Candidate]]:
    """Units of a mesh file in which the skins lie on it, and the candidates for its tables then.

    The first is the choice: metres where no unit fits. More than one where mesh and tables fit
    alike in other units, as two files in one unit do in any; not where the file settles it, or
    the unit that the tables are stated to be in.
    """
    known = KNOWN_UNITS if units is None else (units,)
    fits, off, alike = {}, {}, {}
    for unit in KNOWN_UNITS:
        robot = Robot(mesh.stem, MeshBody(mesh, scale=UNITS[unit]), {})
        fits[unit] = found = [candidates(part, one, robot, known, robot.body.links)[0]
                              for part, one in tables.items()]  # fmt: skip
        off[unit] = max(one.off if one.plausible else np.inf for one in found)
        alike[unit] = max(one.relative if one.plausible else np.inf for one in found)
    limit = max(CLEARER * min(alike.values()), SHARE)
    if min(alike.values()) > FITS:
        best = min(off, key=lambda unit: off[unit])
        return {best: fits[best]}
    names = [unit for unit in KNOWN_UNITS if alike[unit] <= limit]
    names = [unit for unit in names if UNITS[unit] == file_metres(mesh)] or names
    # A flat skin lies on a flat mesh in any pair of units: most likely they have one.
    names.sort(key=lambda unit: sum(one.units != unit for one in fits[unit]))
    chosen = {tuple(one.units for one in fits[unit]): unit for unit in reversed(names)}
    return {unit: fits[unit] for unit in reversed(chosen.values())}


def unclear(found: Sequence[Candidate]) -> list[str]:
    """Which of "units" and "link" candidates leave open; the first of them is the choice.

    Clear is what no other plausible candidate contradicts: where the skin lies on a link in the
    first, others contradict that only where it lies about as near, or may: where their mesh cannot
    be read and the first is not close.
    """
    best = found[0]
    known, far = best.off <= NEAR, max(CLEARER * best.off, APART)
    rivals = [
        one
        for one in found
        if ((one.plausible or not best.plausible) and not (known and one.off >= far))
        or (one.unread and one.plausible and best.off > APART)
    ]
    return [
        question
        for question in ("units", "link")
        if any(getattr(one, question) != getattr(best, question) for one in rivals)
    ]


def in_question(found: Sequence[Candidate], questions: Collection[str]) -> list[Candidate]:
    """Candidates that differ from the first only in what is open."""
    settled = {"units", "link"} - {*questions}
    return [
        one
        for one in found
        if all(getattr(one, name) == getattr(found[0], name) for name in settled)
    ]


def part_names(files: Sequence[Path]) -> list[str]:
    """A name for each table: its file's, with its folder's where two files have one name."""
    stems = [file.stem for file in files]
    names = [
        f"{file.resolve().parent.name}_{file.stem}" if stems.count(file.stem) > 1 else file.stem
        for file in files
    ]
    return [
        name if names.count(name) == 1 else f"{name}_{names[:row].count(name) + 1}"
        for row, name in enumerate(names)
    ]


def write_manifest(
    output: Path, body: UrdfBody, units: str, parts: Mapping[Path, Candidate], *, force: bool
) -> list[str]:
    """Write a manifest, and copies beside it of what lies elsewhere; all of it or nothing.

    Parameters
    ----------
    output : Path
        The manifest.
    body : UrdfBody
        Of a URDF or of one mesh.
    units : str
        Of the mesh; a URDF has its own.
    parts : mapping of Path to Candidate
    force : bool
        Whether copies replace files that are there.

    Returns
    -------
    list of str
        What was written, the manifest first.

    Raises
    ------
    OutputError
        The folder cannot be written to, or another file has the name of a copy.
    MissingFileError
        The mesh of a part's link does not exist.
    """
    folder = output.parent
    beside = _Beside(folder)
    for part in parts.values():
        body.mesh(part.link)
    taxels = [beside.place(file, one.part + file.suffix) for file, one in parts.items()]
    if isinstance(body, MeshBody):
        own = [f"mesh = {_text(beside.place_mesh(body.path))}", f"units = {_text(units)}"]
    else:
        own = [f"urdf = {_text(beside.place_urdf(body))}"]
    lines = ["[robot]", f"name = {_text(robot_name(body))}", *own]
    for part, table in zip(parts.values(), taxels, strict=True):
        lines += [
            "",
            "[[part]]",
            f"name = {_text(part.part)}",
            f"link = {_text(part.link)}     # the frame that the positions are in",
            f"taxels = {_text(table)}",
            f"units = {_text(part.units)}",
        ]
    copies = dict(beside.missing(force))
    with staged_folder(folder) as stage:
        for target, content in copies.items():
            place = stage / target
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(content)
        (stage / output.name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return [str(output), *(str(folder / target) for target in copies)]


def robot_name(body: UrdfBody) -> str:
    """The name in a URDF, or that of a mesh file."""
    if isinstance(body, MeshBody):
        return body.path.stem
    return str(read_urdf(body.path).get("name"))


def _text(value: str) -> str:
    """A text as TOML writes it, which is as JSON does."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


class _Beside:
    """Files that a manifest names: those in its folder as they are, others as copies there."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.home = folder, folder.resolve()
        self.copies: dict[str, Path | bytes] = {}

    def place(self, file: Path, name: str) -> str:
        """The name of a file in the folder; one from elsewhere is copied to a name."""
        own = file.resolve()
        if own.is_relative_to(self.home):
            return own.relative_to(self.home).as_posix()
        path, number = Path(name), 2
        while self.copies.get(name, own) != own:  # another file has it
            name, number = path.with_stem(f"{path.stem}_{number}").as_posix(), number + 1
        self.copies[name] = own
        return name

    def place_mesh(self, mesh: Path, name: str = "") -> str:
        """The name of a mesh in the folder, with the files beside it that hold its numbers."""
        there = self.place(mesh, name or mesh.name)
        for buffer in _buffers(mesh):
            self.place(buffer, (Path(there).parent / buffer.name).as_posix())
        return there

    def place_urdf(self, body: UrdfBody) -> str:
        """The name of a URDF in the folder, with its meshes; changed where it names others."""
        urdf = body.path
        root, own = read_urdf(urdf), urdf.resolve()
        inside = own.is_relative_to(self.home)
        name = own.relative_to(self.home).as_posix() if inside else urdf.name
        changed = False
        for element in (one for one in root.iter() if local_name(one) == "mesh"):
            said = str(element.get("filename"))
            try:
                mesh = body.locate(said).resolve()
            except MissingFileError:
                continue  # of a link that carries no skin, or for collisions
            if inside and mesh.is_relative_to(self.home):
                continue
            if mesh.suffix.lower() not in MESH_SUFFIXES:
                continue
            near = Path(said.removeprefix("package://"))
            if ":" in said.removeprefix("package://") or ".." in near.parts or near.is_absolute():
                near = Path("meshes") / mesh.name
            there = Path(self.place_mesh(mesh, (Path(name).parent / near).as_posix()))
            if there != Path(name).parent / said.removeprefix("package://"):
                element.set("filename", there.relative_to(Path(name).parent).as_posix())
                changed = True
        if not changed:
            return self.place(urdf, name)
        if inside:
            name = Path(name).with_stem(f"{urdf.stem}_here").as_posix()
        from lxml import etree

        self.copies[name] = etree.tostring(root.getroottree(), encoding="utf-8")
        return name

    def missing(self, force: bool) -> Iterator[tuple[str, bytes]]:
        """The copies that are not there yet, by their names."""
        for name, source in self.copies.items():
            content = source if isinstance(source, bytes) else source.read_bytes()
            there = self.folder / name
            if there.is_file() and there.read_bytes() == content:
                continue
            if there.exists() and not (force and there.is_file()):
                raise OutputError(f"{str(there)!r} is there already; --force replaces it")
            yield name, content


def _buffers(mesh: Path) -> list[Path]:
    """Files beside a .gltf that hold its numbers."""
    if mesh.suffix.lower() != ".gltf":
        return []
    told: dict[str, Any] = json.loads(mesh.read_text(encoding="utf-8"))
    names = [str(one.get("uri", "data:")) for one in told.get("buffers", ())]
    return [mesh.parent / name for name in names if (mesh.parent / Path(name).name).is_file()]
