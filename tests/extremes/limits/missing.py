"""Laws of skins that lack modules or whose taxels are dead: meshes, maps, structures, images."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from skinmap.errors import SkinMismatchError
from skinmap.flat.flat_map import flatten
from skinmap.live.contacts.sample_contacts import centre_of_pressure
from skinmap.neighbours.offsets import neighbourhoods
from skinmap.neighbours.structures import assign, find_structures
from skinmap.surface.surface_mesh import build_surface
from skinmap.touch.contacts.contact_geometry import contact_geometry
from skinmap.touch.contacts.skin_geometry import find_contacts
from skinmap.touch.histograms.codebook import histograms, learn_codebook
from skinmap.touch.prepared_skin import PreparedSkin

from .law import Law, Outside
from .shapes import PITCH, bent_skin, lattice, prepared, press, with_holes

SIDE = 20


@cache
def holed(modules: int) -> PreparedSkin:
    """The lattice of 400 without so many blocks of nine taxels."""
    return PreparedSkin(bent_skin(SIDE, SIDE, keep=with_holes(modules)))


def pressed(modules: int, row: int = 210) -> np.ndarray:
    """A finger on what is left of it."""
    places = lattice(SIDE, SIDE)
    gap = np.linalg.norm(places - places[row], axis=1)[with_holes(modules)]
    return np.asarray(200.0 * np.exp(-0.5 * (gap / 9e-3) ** 2))


def unflat(modules: int) -> float:
    """Taxels without a place on the flat map, and triangles turned over."""
    flat = holed(modules).flat
    return float((~np.isfinite(flat.uv).all(axis=1)).sum() + flat.flips)


def strained(modules: int) -> float:
    return float(max(chart.distortion.edge_rms for chart in holed(modules).flat.charts))


def turned_over(noise: float) -> float:
    return float(flatten(build_surface(bent_skin(noise=noise))).flips)


def flat_hoods(keep: np.ndarray) -> Any:
    row, column = np.divmod(np.arange(SIDE * SIDE), SIDE)
    flat = PITCH * np.column_stack([column + 0.5 * (row % 2), row * np.sqrt(0.75), 0 * row])[keep]
    up, north = np.tile([0.0, 0, 1], (len(flat), 1)), np.tile([0.0, 1, 0], (len(flat), 1))
    return neighbourhoods(flat, up, north, radius=8e-3, band=1e-3)


def restructured(modules: int) -> float:
    """Taxels that have all six neighbours and another structure than most of these."""
    hoods = flat_hoods(with_holes(modules))
    whole = hoods.filled.sum(axis=1) == hoods.filled.sum(axis=1).max()
    labels = find_structures(hoods, rotations=6).labels[whole]
    return float((labels != np.bincount(labels).argmax()).sum())


def reassigned(modules: int) -> float:
    """Whole neighbourhoods that a table learnt on the whole lattice knows by another shape."""
    every = find_structures(flat_hoods(np.ones(SIDE * SIDE, bool)), rotations=6)
    hoods = flat_hoods(with_holes(modules))
    whole = hoods.filled.sum(axis=1) == hoods.filled.sum(axis=1).max()
    labels = assign(hoods, every.prototypes).labels[whole]
    return float((labels != np.bincount(every.labels).argmax()).sum())


def image_changes(modules: int) -> float:
    """Of a constant field on what is left of the skin."""
    image = holed(modules).image_geometry
    return float(np.abs(image.image(np.full(len(holed(modules)), 80.0))[image.mask] / 80 - 1).max())


def fewer_votes(modules: int) -> float:
    """Change of a press' histogram, in shares of its votes, against the whole skin."""
    found = []
    words, structures = book()
    for number in (0, modules):
        own = assign(holed(number).hoods, structures.prototypes)
        found.append(histograms(words, own, pressed(number)[None])[0])
    return float(np.abs(found[1] - found[0]).sum() / found[0].sum())


@cache
def book() -> tuple[Any, Any]:
    rng = np.random.default_rng(0)
    structures = find_structures(holed(0).hoods, rotations=6)
    samples = np.stack([pressed(0, int(row)) for row in rng.integers(SIDE * SIDE, size=30)])
    return learn_codebook([(structures, samples)], rng=rng), structures


def contacts_beside_one(modules: int) -> float:
    return float(find_contacts(holed(modules).geometry, pressed(modules)).number.max())


def changed_votes(share: float) -> float:
    """Change of a press' histogram where taxels are dead, in shares of its votes."""
    words, structures = book()
    values = np.tile(pressed(0), (2, 1))
    values[1, np.random.default_rng(5).random(values.shape[1]) < share] = 0.0
    one, other = histograms(words, structures, values)
    return float(np.abs(one - other).sum() / one.sum())


def clipped(share: float) -> float:
    """Change of a press' area where its strongest taxels read 255, in shares of it."""
    values = press(peak=255.0)
    full = values.copy()
    full[np.argsort(-values)[: int(share * 144)]] = 255.0
    one, other = (contact_geometry(prepared().geometry, v) for v in (values, full))
    return float(abs(other[0] / one[0] - 1))


def centre_off(share: float) -> float:
    """Way of the centre of pressure, in pitches, where the middle of a press is cut off."""
    values = np.minimum(press(peak=255.0), 255.0 * (1 - share))
    return float(np.linalg.norm(centre_of_pressure(prepared(), values) - lattice()[78]) / PITCH)


def image_of(share: float) -> float:
    """Change of the image's sum, in shares of it, where taxels are dead."""
    image = prepared().image_geometry
    values = press()
    dead = values.copy()
    dead[np.random.default_rng(3).permutation(144)[: int(share * 144)]] = 0.0
    return float(abs(image.image(dead).sum() / image.image(values).sum() - 1))


def of_other_skin() -> object:
    words, structures = book()
    return histograms(words, structures, np.zeros((1, 12)))


GONE = (0, 1, 6)
LAWS = [
    Law("flatten", "missing modules", "all others have a place, none turned over", unflat, 0.0,
        "counted", GONE, unit="of nine taxels"),
    Law("flatten", "missing modules", "strain of edges", strained, 0.02,
        "a bent sheet can be laid flat; holes that are closed over bulge", GONE,
        unit="of nine taxels"),
    Law("flatten", "noise", "no triangle turned over", turned_over, 0.0, "counted",
        (0.0, 0.02, 0.05, 0.1), unit="of the pitch"),
    Law("find_structures", "missing modules", "whole neighbourhoods keep one structure",
        restructured, 0.0, "counted", GONE, unit="of nine taxels"),
    Law("assign", "missing modules", "whole neighbourhoods keep their structure", reassigned, 0.0,
        "counted", GONE, unit="of nine taxels"),
    Law("find_contacts", "missing modules", "one press is one contact", contacts_beside_one, 0.0,
        "counted", GONE, unit="of nine taxels"),
    Law("centre_of_pressure", "saturation", "in pitches from where the press is", centre_off, 0.3,
        "a taxel's neighbours weigh alike then", (0.0, 0.3, 0.6), unit="of the peak cut off"),
    Law("contact_geometry", "saturation", "change of the area", clipped, 0.02,
        "those full were felt before", (0.0, 0.05), unit="of the taxels at 255"),
    Law("ContactImageGeometry.image", "missing modules", "a constant stays", image_changes, 1e-5,
        "single precision", GONE, unit="of nine taxels"),
    Law("ContactImageGeometry.image", "dead taxels", "change of its sum", image_of, 0.3,
        "a fifth of the taxels of one press, strong ones perhaps", (0.0, 0.05, 0.1, 0.2),
        unit="of the taxels"),
    Law("histograms", "missing modules", "change of votes", fewer_votes, 1.0,
        "neighbours of a hole vote for other words: of a press beside one, half at most",
        GONE, (Outside("another skin", SkinMismatchError, of_other_skin),), "of nine taxels"),
    Law("histograms", "dead taxels", "change of votes", changed_votes, 1.0,
        "a dead taxel changes the words of its six neighbours", (0.0, 0.02, 0.05),
        unit="of the taxels"),
]  # fmt: skip
