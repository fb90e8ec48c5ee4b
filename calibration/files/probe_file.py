"""Probes of self-touch: fingertips without taxels, and what they sit on (TOML).

[[probe]]
name = "right_finger"     # as recordings name it
link = "r_hand"           # link of the robot that it sits on; or
part = "right_hand"       # the part on whose link it sits
tip_mm = [-120, -15, 10]  # where the tip is thought to be in that link, if at all
radius_mm = 7             # how round it is, if that is known
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skinmap.arrays import FloatArray, check_finite
from skinmap.errors import DataFormatError, InvalidArrayError, MissingFileError
from skinmap.io.text import is_file, read_text

KEYS = ("name", "link", "part", "tip_mm", "radius_mm")
BESIDE = "probes.toml"  # read from beside the recordings where no other is named
MAX_MM = 5000.0  # of a tip in its link: more are other units


@dataclass(frozen=True, eq=False, slots=True)
class Probe:
    """A point of a robot that touches skin and feels nothing.

    Attributes
    ----------
    name : str
    link, part : str
        Link that it sits on, or part on whose link it sits; one of them is empty.
    tip : (3,) float or None
        Where it is thought to be in that link [m].
    radius : float
        [m]; 0 where it is not known.
    """

    name: str
    link: str = ""
    part: str = ""
    tip: FloatArray | None = None
    radius: float = 0.0

    @property
    def mount(self) -> FloatArray:
        """(4, 4) of the assumed tip; the identity where there is none."""
        mount = np.eye(4)
        if self.tip is not None:
            mount[:3, 3] = self.tip
        return mount


def read_probes(path: Path) -> dict[str, Probe]:
    """The probes of a file by their names.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or one that is no list of probes (names it, with the reason).
    """
    if not is_file(path):
        raise MissingFileError(path, "a file of probes (.toml)")
    try:
        document = tomllib.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise DataFormatError(f"not TOML: {str(error)[:200]}", path) from None
    entries = document.get("probe")
    if set(document) - {"probe"} or not isinstance(entries, list):
        raise DataFormatError(
            f"a file of probes holds [[probe]] only, got {', '.join(document) or 'nothing'}", path
        )
    probes: dict[str, Probe] = {}
    for number, entry in enumerate(entries, start=1):
        probe = _probe(entry, f"[[probe]] number {number}", path)
        if probe.name in probes:
            raise DataFormatError(f"two probes are called {probe.name!r}", path)
        probes[probe.name] = probe
    return probes


def _probe(entry: Any, what: str, path: Path) -> Probe:
    if not isinstance(entry, dict) or (unknown := [key for key in entry if key not in KEYS]):
        wrong = ", ".join(unknown) if isinstance(entry, dict) else repr(entry)
        raise DataFormatError(f"{what}: unknown {wrong}; the keys are: {', '.join(KEYS)}", path)
    words = {key: _word(entry, key, what, path) for key in ("name", "link", "part")}
    if not words["name"]:
        raise DataFormatError(f"{what} lacks 'name'", path)
    if bool(words["link"]) == bool(words["part"]):
        raise DataFormatError(f"probe {words['name']!r} needs either 'link' or 'part'", path)
    try:
        tip = check_finite(entry["tip_mm"], "tip_mm", (3,)) if "tip_mm" in entry else None
        radius = float(check_finite([entry.get("radius_mm", 0.0)], "radius_mm", (1,))[0])
    except InvalidArrayError as error:
        raise DataFormatError(f"probe {words['name']!r}: {error}", path) from None
    if not 0.0 <= radius <= MAX_MM or (tip is not None and np.abs(tip).max() > MAX_MM):
        raise DataFormatError(
            f"probe {words['name']!r}: lengths are millimetres, {MAX_MM:.0f} at most", path
        )
    return Probe(**words, tip=None if tip is None else 1e-3 * tip, radius=1e-3 * radius)


def _word(entry: Mapping[str, Any], key: str, what: str, path: Path) -> str:
    value = entry.get(key, "")
    if not isinstance(value, str):
        raise DataFormatError(f"{what}: {key} must be a text, got {value!r}", path)
    return value
