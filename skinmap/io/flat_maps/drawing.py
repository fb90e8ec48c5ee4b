"""Hand-drawn flat maps of the iCub's skin (`skinGui/*.ini`), to compare ours with.

After a line `[SENSORS]` comes one module a line: `type id X Y theta_deg gain [mirror [layout]]`, in
mm with y up. A module's own places are mirrored (x negated) if `mirror` is 1, then turned by theta,
then moved. Channels are not written down: they are counted through the ids, and an id that is not
drawn takes twelve.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skinmap.arrays import FloatArray, IntArray, check_finite, freeze
from skinmap.errors import DataFormatError, InvalidArrayError, warn
from skinmap.io.text import parse_floats, parse_whole, read_text
from skinmap.skin.modules import BUILTIN

SECTION = "[SENSORS]"
CHANNELS_PER_ID = 12  # of an id that is not drawn
MAX_IDS = 10_000
MAX_MILLIMETRES = 1e5

# The files do not say which point of the palm its `X Y` means: we take the mean of its tactile
# slots.
_PALM = np.loadtxt(Path(__file__).with_name("palm.csv"), int, delimiter=",")
_PALM_TACTILE = np.setdiff1d(np.arange(48), [11, 23, 35, 43])  # the others are thermal pads
_PALM_XY = 1e-4 * (_PALM[:, :2] - _PALM[_PALM_TACTILE, :2].mean(axis=0))


def _tactile(name: str) -> tuple[IntArray, FloatArray]:
    slots = np.flatnonzero(~BUILTIN[name].thermal)
    return slots, BUILTIN[name].xy[slots]


# Type: tactile slots (k,) and their places (k, 2) [m] in the module's own frame.
PLACES = {
    "triangle": _tactile("triangle_12pad"),
    "triangle_10pad": _tactile("triangle_10pad"),
    "palmL": (_PALM_TACTILE, _PALM_XY[_PALM_TACTILE]),
    "palmR": (_PALM_TACTILE, _PALM_XY[_PALM[_PALM_TACTILE, 2]]),
}
# Type: channels it takes. The position files of the hands tell those of the fingertips: five times
# twelve channels, then three ids that are not drawn, then the palm at channel 96.
CHANNELS = {
    **dict.fromkeys(("triangle", "triangle_10pad"), 12),
    **dict.fromkeys(("palmL", "palmR"), 48),
    **dict.fromkeys(("fingertip", "fingertip2L", "fingertip2R", "fingertip3L", "fingertip3R"), 12),
}


@dataclass(frozen=True, eq=False, slots=True)
class Drawing:
    """Taxels of a part as drawn by hand in the plane, ordered by channel.

    Attributes
    ----------
    channels : (n,) int
        Place of each taxel in the live vector; thermal pads are left out.
    modules : (n,) int
        Channel div 12, as in the position files.
    xy : (n, 2) float
        [m], y up.
    skipped : tuple of str
        What was left out: line, type, id and why.
    """

    channels: IntArray
    modules: IntArray
    xy: FloatArray
    skipped: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        xy = check_finite(self.xy, "xy", (None, 2))
        channels, modules = np.asarray(self.channels, int), np.asarray(self.modules, int)
        if not channels.shape == modules.shape == (len(xy),):
            raise InvalidArrayError(
                f"channels and modules must have shape ({len(xy)},), "
                f"got {channels.shape} and {modules.shape}"
            )
        order = np.argsort(channels)
        freeze(self, channels=channels[order], modules=modules[order], xy=xy[order])

    def __len__(self) -> int:
        return len(self.channels)


@dataclass(frozen=True, slots=True)
class _Module:
    line: int
    type: str
    id: int
    x: float
    y: float
    theta: float
    mirror: bool
    layout: int

    def __str__(self) -> str:
        return f"line {self.line}: {self.type} {self.id}"


def read_drawing(path: Path) -> Drawing:
    """Read a drawing; a `SkinWarning` names each line that is left out, and why.

    Left out are types whose taxel places are not known, a second module of the same id (the first
    one counts), and what follows a type of unknown size, since its channels cannot be counted.

    Raises
    ------
    DataFormatError
        No `[SENSORS]`, a line that is wrong (named), or nothing that could be placed.
    """
    modules, skipped = _without_duplicates(_modules(path))
    channels: list[IntArray] = []
    places: list[FloatArray] = []
    lost = ""  # the type whose size is not known, once there was one
    next_channel, next_id = 0, 0
    for module in modules:
        start = next_channel + CHANNELS_PER_ID * (module.id - next_id)
        next_channel, next_id = start + CHANNELS.get(module.type, 0), module.id + 1
        if reason := _why_not(module, lost):
            skipped.append((module.line, f"{module}: {reason}"))
        else:
            slots, xy = PLACES[module.type]
            channels.append(start + slots)
            places.append(_moved(xy, module))
        if module.type not in CHANNELS:
            lost = lost or f"{module.type} {module.id}"
    notes = tuple(note for _, note in sorted(skipped))
    if not channels:
        raise DataFormatError(f"nothing to place: {'; '.join(notes) or 'no module'}", path)
    if notes:
        warn(f"{path}: left out {'; '.join(notes)}")
    numbers = np.concatenate(channels)
    return Drawing(numbers, numbers // CHANNELS_PER_ID, np.concatenate(places), notes)


def _modules(path: Path) -> list[_Module]:
    lines = read_text(path).splitlines()
    start = next((i + 1 for i, text in enumerate(lines) if text.strip() == SECTION), 0)
    if start == 0:
        raise DataFormatError(f"no line {SECTION}", path)
    found: list[_Module] = []
    for line, text in enumerate(lines[start:], start=start + 1):
        words = text.partition("#")[0].split()
        if words and words[0].startswith("["):
            break  # another section
        if len(found) == MAX_IDS:
            raise DataFormatError(f"more than {MAX_IDS} modules", path, line)
        if words:
            found.append(_module(words, path, line))
    return found


def _module(words: list[str], path: Path, line: int) -> _Module:
    if not 6 <= len(words) <= 8:
        raise DataFormatError(
            f"expected type id X Y theta gain [mirror [layout]], got {len(words)} words", path, line
        )
    (number,) = parse_whole(words[1:2], path, line)
    x, y, theta, _ = parse_floats(words[2:6], path, line)
    mirror, layout = parse_whole([*words[6:], "0", "0"][:2], path, line)
    if not 0 <= number < MAX_IDS:
        raise DataFormatError(f"id {number} is not in 0..{MAX_IDS - 1}", path, line)
    if mirror not in (0, 1):
        raise DataFormatError(f"mirror must be 0 or 1, got {mirror}", path, line)
    if max(abs(x), abs(y), abs(theta)) > MAX_MILLIMETRES:
        raise DataFormatError(f"a place or an angle beyond {MAX_MILLIMETRES:.0f}", path, line)
    return _Module(line, words[0], number, x, y, theta, mirror == 1, layout)


def _without_duplicates(modules: list[_Module]) -> tuple[list[_Module], list[tuple[int, str]]]:
    """The first module of each id, by id, and a note on each of the others."""
    first: dict[int, _Module] = {}
    notes = []
    for module in modules:
        kept = first.setdefault(module.id, module)
        if kept is not module:
            notes.append((module.line, f"{module}: id {module.id} is drawn in line {kept.line}"))
    return [first[number] for number in sorted(first)], notes


def _why_not(module: _Module, lost: str) -> str:
    if module.type not in PLACES:
        return "its taxel places are not known"
    if lost:
        return f"it follows {lost}, whose number of channels is not known"
    if module.layout != 0:
        return f"its layout {module.layout} is not known"
    return ""


def _moved(xy: FloatArray, module: _Module) -> FloatArray:
    cosine, sine = math.cos(math.radians(module.theta)), math.sin(math.radians(module.theta))
    rotation = np.array([[cosine, -sine], [sine, cosine]])
    local = xy * [-1.0 if module.mirror else 1.0, 1.0]
    return local @ rotation.T + 1e-3 * np.array([module.x, module.y])
