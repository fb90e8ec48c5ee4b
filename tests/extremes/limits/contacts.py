"""Laws of contacts, contact images and histograms."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from skinmap.errors import InvalidArrayError, SkinMismatchError
from skinmap.live.contacts.sample_contacts import centre_of_pressure
from skinmap.neighbours.structures import Structures, find_structures
from skinmap.touch.contacts.contact_geometry import contact_geometry
from skinmap.touch.contacts.skin_geometry import find_contacts
from skinmap.touch.histograms.codebook import Codebook, histograms, learn_codebook

from .law import Law, Outside
from .shapes import PITCH, lattice, prepared, press


def pressures(**at: float) -> np.ndarray:
    """A press with some taxels set to other values."""
    values = press()
    for row, value in at.items():
        values[int(row[1:])] = value
    return values


def contacts_of(scale: float) -> float:
    """Contacts beside the one that is there; the active taxels must be those of its shape."""
    shape = press() / press().max()
    label = find_contacts(prepared().geometry, scale * shape).number
    return float(abs(label.max() + 1 - 1))


def saturated(share: float) -> float:
    """Contacts beside one, where the strongest taxels all read 255."""
    values = press()
    strong = np.argsort(-values)[: int(share * 144)]
    values[strong] = 255.0
    return float(find_contacts(prepared().geometry, values).number.max())


def off_centre(dead: float) -> float:
    """How far the centre of pressure moves where some taxels read 0, in pitches."""
    values = press()
    values[np.random.default_rng(3).permutation(144)[: int(dead * 144)]] = 0.0
    return float(np.linalg.norm(centre_of_pressure(prepared(), values) - lattice()[78]) / PITCH)


def numbers_of(taxels: int) -> float:
    """Contact geometry of so many active taxels: how many of its numbers are not finite."""
    values = np.zeros(144)
    values[:taxels] = 200.0
    return float((~np.isfinite(contact_geometry(prepared().geometry, values))).sum())


def image_off(scale: float) -> float:
    """A constant field in the contact image."""
    image = prepared().image_geometry
    found = image.image(np.full(144, scale))[image.mask]
    return float(np.abs(found / scale - 1).max())


@cache
def book() -> tuple[Structures, Codebook, np.ndarray]:
    rng = np.random.default_rng(0)
    structures = find_structures(prepared().hoods, rotations=6)
    samples = np.stack([press(int(row), 1.0) for row in rng.integers(144, size=30)])
    return structures, learn_codebook([(structures, samples)], rng=rng), samples


def votes(change: Any) -> int:
    structures, words, samples = book()
    return int(histograms(words, structures, change(samples)).sum(axis=1).max())


def votes_off(scale: float) -> float:
    """Votes above one a taxel, which is all there are."""
    return float(max(0, votes(lambda samples: scale * samples) - 144))


def dead(share: float) -> Any:
    return lambda x, rng: np.where(rng.random(x.shape[1]) < share, 0, x).astype(np.uint8)


LAWS = [
    Law(
        "find_contacts",
        "scale",
        "one press is one contact",
        contacts_of,
        0.0,
        "counted",
        (20.0, 255.0, 1e6, 1e300),
        (
            Outside(
                "up to 12 counts",
                "no contact",
                lambda: (
                    "no contact"
                    if not find_contacts(prepared().geometry, 12.0 * press() / press().max())
                    else "some"
                ),
            ),
            Outside(
                "NaN",
                InvalidArrayError,
                lambda: find_contacts(prepared().geometry, pressures(t5=np.nan)),
                "taxel 5",
            ),
            Outside(
                "143 pressures",
                SkinMismatchError,
                lambda: find_contacts(prepared().geometry, press()[1:]),
                "143 pressures",
            ),
        ),
        unit="counts at the peak",
    ),
    Law(
        "find_contacts",
        "saturation",
        "one press is one contact",
        saturated,
        0.0,
        "counted",
        (0.0, 0.05, 0.5, 1.0),
        unit="of the taxels",
    ),
    Law(
        "centre_of_pressure",
        "dead taxels",
        "in pitches from where the press is",
        off_centre,
        1.0,
        "a taxel beside it",
        (0.0, 0.05, 0.1, 0.2),
        unit="of the taxels",
    ),
    Law(
        "contact_geometry",
        "size",
        "all numbers are finite",
        numbers_of,
        0.0,
        "counted",
        (0, 1, 2, 3, 12, 144),
        (
            Outside(
                "infinity",
                InvalidArrayError,
                lambda: contact_geometry(prepared().geometry, pressures(t5=np.inf)),
                "taxel 5",
            ),
        ),
        unit="active taxels",
    ),
    Law(
        "ContactImageGeometry.image",
        "scale",
        "a constant stays",
        image_off,
        1e-5,
        "single precision",
        (1e-30, 1e-6, 1.0, 255.0, 1e6, 1e30),
        (
            Outside(
                1e300,
                InvalidArrayError,
                lambda: prepared().image_geometry.image(np.full(144, 1e300)),
            ),
            Outside(
                "NaN",
                InvalidArrayError,
                lambda: prepared().image_geometry.image(pressures(t5=np.nan)),
            ),
            Outside(
                "143 pressures",
                SkinMismatchError,
                lambda: prepared().image_geometry.image(press()[1:]),
            ),
        ),
    ),
    Law(
        "histograms",
        "scale",
        "at most one vote a taxel",
        votes_off,
        0.0,
        "counted",
        (0.0, 1e-30, 1e-6, 1.0, 255.0, 1e6, 1e100),
        (
            Outside(
                1e200, InvalidArrayError, lambda: votes(lambda x: 1e200 * x), "expected pressures"
            ),
            Outside("NaN", InvalidArrayError, lambda: votes(lambda x: x * np.nan)),
            Outside("143 taxels", SkinMismatchError, lambda: votes(lambda x: x[:, 1:])),
        ),
    ),
]
