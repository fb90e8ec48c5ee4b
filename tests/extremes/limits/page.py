"""docs/limits.md, written from the laws and from what they measured."""

from __future__ import annotations

import re

from . import (
    calibrations,
    classifying,
    contacts,
    flat_maps,
    following,
    kept,
    missing,
    mounts,
    places,
    samples,
    surfaces,
)
from .law import Law, Measured, one_digit

CHAPTERS = {
    "Triangles and surface meshes": surfaces.LAWS,
    "Where taxels are": places.LAWS,
    "Flat maps, geodesics, structures": flat_maps.LAWS,
    "Contacts, images, histograms": contacts.LAWS,
    "Missing modules, dead and full taxels": missing.LAWS,
    "Classifiers and the simulator": classifying.CLASSIFY,
    "Calibration": calibrations.LAWS + mounts.LAWS,
    "Live samples and taxel tables": samples.LAWS,
    "The live loop, contacts and baselines": following.LAWS,
    "What is written and read again": kept.LAWS,
    "The viewer's colours": classifying.VIEWER,
}
LAWS = [law for laws in CHAPTERS.values() for law in laws]
HEAD = """# Limits

Written by `make limits` from the laws of `tests/extremes/limits`; the test suite runs each of them
and refuses a page that differs. A range names the least and the largest value that was
tried, at steps in between; a list names each. Beyond the range nothing is promised except where the
last column names the result: an error or warning by name, or what comes back. "Found" is the
largest deviation that was measured, rounded up to one digit; it may differ between machines,
"allowed" may not. Planted and simulated data, as everywhere in the suite.
"""
COLUMNS = ("function", "axis", "what holds", "within", "allowed", "found", "outside")
FOUND = COLUMNS.index("found")


def page(measured: dict[str, Measured]) -> str:
    """The page, from what each law came to, by its name."""
    text = [HEAD]
    for title, laws in CHAPTERS.items():
        rows = [_row(measured[law.name]) for law in laws]
        table = [COLUMNS, ("---",) * len(COLUMNS), *rows]
        text.append(f"## {title}\n")
        text += ["| " + " | ".join(row) + " |" for row in table] + [""]
    return "\n".join(text)


def same_on_all_machines(text: str) -> str:
    """The page without the column of what was found."""
    lines = []
    for line in text.splitlines():
        cells = re.split(r"(?<!\\)\|", line)
        if len(cells) == len(COLUMNS) + 2:
            del cells[FOUND + 1]
        lines.append("|".join(cells))
    return "\n".join(lines)


def _row(found: Measured) -> tuple[str, ...]:
    law: Law = found.law
    outside = "; ".join(
        f"{one.value}: {said}" for one, said in zip(law.outside, found.reactions, strict=True)
    )
    tried = bool(law.inside)
    return (
        f"`{law.function}`", law.axis, law.law, law.range(),
        (f"{law.bound:g}: {law.why}" if law.bound else f"exact: {law.why}") if tried else "",
        one_digit(found.worst) if tried else "", outside,
    )  # fmt: skip
