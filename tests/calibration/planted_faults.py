"""Faults of wiring from words, for tests that plant them, and tables of touched places."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calibration.wiring import Fault
from calibration.wiring.boards import Boards
from calibration.wiring.faults import chain_faults
from skinmap.errors import InvalidArrayError, UnknownNameError


def parse_fault(text: str, boards: Boards) -> Fault:
    """A fault from words such as `swap:3,7`, `turn:5,120`, `mirror:5`, `mute:4`, `chains:0,1`.

    Raises
    ------
    UnknownNameError, InvalidArrayError
        Another word, module or chain, or another number of them.
    """
    name, _, rest = text.partition(":")
    counts = {"swap": (2,), "turn": (1, 2), "mirror": (1, 2), "mute": (1,), "chains": (2,),
              "reverse": (1,), "mute-chain": (1,), "channels": (2,)}  # fmt: skip
    if name not in counts:
        raise UnknownNameError("fault", name, tuple(counts))
    try:
        values = [int(word) for word in rest.split(",")]
    except ValueError:
        values = []
    if len(values) not in counts[name]:
        raise InvalidArrayError(
            f"{text!r} is no fault: {name} takes {' or '.join(map(str, counts[name]))} whole "
            "numbers after the colon"
        )
    if name in ("chains", "reverse", "mute-chain"):
        return _chain_fault(name, values, boards)
    if name == "channels":
        return _channel_fault(values, boards)
    count = 2 if name == "swap" else 1
    modules = tuple(_module(number, boards) for number in values[:count])
    if name in ("swap", "mute"):
        if len(set(modules)) < count:
            raise InvalidArrayError(f"{text!r}: a module cannot be swapped with itself")
        return Fault("swapped_modules" if name == "swap" else "mute_module", tuple(sorted(modules)))
    degrees = values[1] if len(values) > 1 else (120 if name == "turn" else 0)
    if degrees not in ((120, 240) if name == "turn" else (0, 120, 240)):
        raise InvalidArrayError(f"{text!r}: boards are turned by 120 or 240 degrees")
    if not boards.turnable:
        raise InvalidArrayError(f"{text!r}: {boards.part!r} has no layout that can be turned")
    kind, first = ("turned_module", 0) if name == "turn" else ("mirrored_module", 3)
    return Fault(kind, modules, element=first + degrees // 120)


def _module(number: int, boards: Boards) -> int:
    found = np.flatnonzero(boards.numbers == number)
    if len(found) == 0:
        raise UnknownNameError(
            f"module of {boards.part!r}", str(number), [str(n) for n in boards.numbers]
        )
    return int(found[0])


def _chain_fault(name: str, values: Sequence[int], boards: Boards) -> Fault:
    kind = {"chains": "swapped_chains", "reverse": "reversed_chain", "mute-chain": "mute_chain"}
    for fault in chain_faults(boards):
        if fault.kind == kind[name] and fault.chains == tuple(sorted(values)):
            return fault
    there = [str(chain) for chain in np.unique(boards.chains)]
    raise UnknownNameError(f"chain of {boards.part!r}", ",".join(map(str, values)), there)


def _channel_fault(values: Sequence[int], boards: Boards) -> Fault:
    rows = [np.flatnonzero(boards.table.channels == value) for value in values]
    if any(len(row) == 0 for row in rows):
        raise InvalidArrayError(f"{boards.part!r} has no channels {values[0]} and {values[1]}")
    spots = [np.argwhere(boards.columns == row[0])[0] for row in rows]
    if spots[0][0] != spots[1][0] or values[0] == values[1]:
        raise InvalidArrayError("two different channels of one module are expected")
    slots = sorted(int(spot[1]) for spot in spots)
    return Fault("swapped_channels", (int(spots[0][0]),), slots=(slots[0], slots[1]))


def write_places(paths: Sequence[np.ndarray], file: Path) -> None:
    """Write the places of touches (p, 3) [m], counted from 1."""
    lines = ["touch,x,y,z"]
    for number, path in enumerate(paths, start=1):
        lines += [f"{number}," + ",".join(map(repr, point)) for point in path.tolist()]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
