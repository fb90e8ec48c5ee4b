"""What is doubtful in CySkin files: said in words, and nothing is changed for it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.errors import InvalidMeshError
from skinmap.geometry.topology import check_surface
from skinmap.geometry.triangles import cross_products, signed_areas, unit
from skinmap.io.taxels.cyskin import CySkin, TactileMap, has_channel, map_fits
from skinmap.skin.taxels import NO_ID

APART = 30.0  # normals and faces that disagree by more in the median are two surfaces [deg]
OFF = 60.0  # a single normal further off its faces than this is wrong [deg]
SAME = 1e-6  # places nearer than this are the same: files round to less [m]
RIGID = 1e-3  # of a rotation: matrices are written with four digits


def file_faults(found: CySkin, file: str = "") -> list[str]:
    """Every fault of one file, a sentence each; `file` is its name, which may contradict it."""
    faults = [*_name_faults(found, file), *_count_faults("the skin", found.stated, found)]
    if len(found):
        faults += [*_id_faults(found.ids), *_frame_faults(found), *_surface_faults(found)]
    keys = Counter(one.key for one in found.maps)
    faults += [f"{count} maps have the key {key}" for key, count in keys.items() if count > 1]
    for one in found.maps:
        faults += _map_faults(one, found)
    return faults


def set_faults(files: Mapping[str, CySkin]) -> dict[str, list[str]]:
    """Faults that several files together have, by file: one place for all, ids given twice."""
    faults: dict[str, list[str]] = {name: [] for name in files}
    skins = {name: found for name, found in files.items() if len(found)}
    for names in _alike(skins):
        for name in names:
            others = ", ".join(other for other in names if other != name)
            faults[name].append(f"stands at the same place as {others}")
    owners: dict[int, list[str]] = {}
    for name, found in skins.items():
        for number in found.ids[found.connected].tolist():
            owners.setdefault(number, []).append(name)
    shared = Counter(pair for own in owners.values() for pair in pairwise(own))
    for (name, other), count in shared.items():
        faults[other].append(f"{count} ids are also those of taxels of {name}")
    return faults


def _alike(skins: Mapping[str, CySkin]) -> Iterator[list[str]]:
    """Names of the files whose taxels stand at the same places, where there are several."""
    groups: list[list[str]] = []
    for name, found in skins.items():
        for group in groups:
            first = skins[group[0]].positions
            if first.shape == found.positions.shape and (
                np.abs(first - found.positions).max() < SAME
            ):
                group.append(name)
                break
        else:
            groups.append([name])
    return (group for group in groups if len(group) > 1)


def _id_faults(ids: IntArray) -> Iterator[str]:
    names, count = np.unique(ids, return_counts=True)
    for name, times in zip(names[count > 1].tolist(), count[count > 1].tolist(), strict=True):
        yield f"{times} taxels have the id {name}: they have a place and no channel"
    alone = ids[~has_channel(ids) & np.isin(ids, names[count == 1])]
    for name in alone.tolist():
        why = "is negative" if name < 0 else "is the only one of its module"
        yield f"the id {name} {why}: its taxel has a place and no channel"


def _frame_faults(found: CySkin) -> Iterator[str]:
    if not found.frames:
        yield "no parent frame: the place of the skin is missing"
    for frame in found.frames:
        if frame.placeholder:
            yield f"tf_matrix is a placeholder: its frame is called {frame.name!r}, no link"
        turn = frame.transform[:3, :3]
        last = frame.transform[3]
        if np.abs(turn @ turn.T - np.eye(3)).max() > RIGID or np.linalg.det(turn) < 0:
            yield f"tf_matrix of frame {frame.name!r} is not a rigid motion"
        elif np.abs(last - [0.0, 0.0, 0.0, 1.0]).max() > RIGID:
            yield f"tf_matrix of frame {frame.name!r} is not written by columns"


def _surface_faults(found: CySkin) -> Iterator[str]:
    faces, count = found.faces, len(found)
    if len(faces) == 0:
        yield "no faces: the skin has no surface of its own"
        return
    try:
        check_surface(faces)
    except InvalidMeshError as error:
        yield f"the faces are not a surface: {error}"
    alone = count - len(np.unique(faces))
    if alone:
        yield f"{alone} of {count} taxels are in no face"
    if not found.normals.any():
        yield "no normals: zeros"
        return
    off = normal_angles(found)
    middle = float(np.median(off))
    if middle > APART:
        yield f"the normals disagree with the faces by {middle:.0f} degrees in the median"
    elif (off > OFF).any():
        wrong = int((off > OFF).sum())
        yield f"{wrong} of {count} normals are more than {OFF:.0f} degrees off the faces"


def normal_angles(found: CySkin) -> FloatArray:
    """(k,) angle between the normal of each taxel in a face and its faces' [deg]."""
    cross = cross_products(found.positions, found.faces)
    own = np.zeros_like(found.positions)
    for corner in range(3):
        np.add.at(own, found.faces[:, corner], cross)
    used = np.unique(found.faces)
    cosine = np.einsum("ij,ij->i", unit(own[used]), unit(found.normals[used]))
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _map_faults(one: TactileMap, found: CySkin) -> Iterator[str]:
    yield from _count_faults(f"map {one.name!r}", one.stated, one)
    if len(found) == 0:
        return
    if not map_fits(found, one):
        yield f"map {one.name!r} is of another skin: {_difference(one, found)}"
        return
    wrong = int(((one.ids != found.ids) & (one.ids != NO_ID)).sum())
    if wrong:
        yield f"map {one.name!r} has other ids in {wrong} of {len(found)} rows: rows count"
    faces = one.faces if len(one.faces) else found.faces
    if len(faces):
        areas = signed_areas(one.uv, faces)
        over = int(min((areas < 0).sum(), (areas > 0).sum()))
        if over:
            yield f"map {one.name!r} turns {over} of {len(faces)} triangles over"


def _difference(one: TactileMap, found: CySkin) -> str:
    if len(one.ids) != len(found):
        return f"{len(one.ids)} taxels, the skin has {len(found)}"
    return "ids and faces both disagree"


def _count_faults(what: str, stated: Sequence[int | None], of: CySkin | TactileMap) -> list[str]:
    faults = []
    for word, said, have in zip(
        ("taxels", "faces"), stated, (len(of.ids), len(of.faces)), strict=True
    ):
        if said is not None and said != have:
            faults.append(f"{what} is stated to have {said} {word} and has {have}")
    return faults


def _name_faults(found: CySkin, file: str) -> Iterator[str]:
    """`info.name` against the names of the maps and of the file: UR10_link2 over link1's maps."""
    own = _numbered(found.name)
    witnesses = [_numbered(name) for name in (*(one.name for one in found.maps), file)]
    for word, number in own.items():
        said = {one[word] for one in witnesses if word in one}
        if said and number not in said:
            others = " and ".join(f"{word}{other}" for other in sorted(said))
            yield f"info.name is {found.name!r}; its maps or its file state {others}"


def _numbered(name: str) -> dict[str, str]:
    """Words of a name that end in a number: {"link": "1"}."""
    pairs = re.findall(r"([a-z]{3,})[_ -]?(\d+)", name.lower())
    return dict(pairs)
