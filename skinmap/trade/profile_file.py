"""Writing a profile: the recommended setting of each task, with what it is predicted to cost."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from skinmap import __version__
from skinmap.profile import FORMAT, Value
from skinmap.trade.points import Point


@dataclass(frozen=True, slots=True)
class Origin:
    """Where the figures of a profile come from.

    Attributes
    ----------
    robot : str
        As it was asked for: a built-in name or the path of a manifest.
    parts : tuple of str
    seed, seeds : int
        The first seed, and how many.
    """

    robot: str
    parts: tuple[str, ...]
    seed: int
    seeds: int


def profile_text(recommended: Sequence[Point], origin: Origin) -> str:
    """The profile as TOML: `[profile]`, then a table a task, each with its `predicted` figures."""
    head: dict[str, Value] = {
        "format": FORMAT,
        "skinmap": __version__,
        "robot": origin.robot,
        "part": ",".join(origin.parts),
        "machine": machine(),
        "seed": origin.seed,
        "seeds": origin.seeds,
    }
    blocks = [_table("profile", head)]
    for point in recommended:
        blocks.append(_table(point.task, point.setting))
        predicted: dict[str, Value] = {
            "seconds": point.seconds,
            "error": point.error,
            "unit": point.unit,
        }
        if point.pace:
            predicted["pace"] = point.pace
        blocks.append(_table(f"{point.task}.predicted", predicted))
    return "\n".join(blocks)


def write_profile(path: Path, recommended: Sequence[Point], origin: Origin) -> None:
    """Write `profile_text` to a file."""
    path.write_text(profile_text(recommended, origin), encoding="utf-8")


def machine() -> str:
    """The processor and its system, in a few words."""
    name = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                name = line.partition(":")[2].strip()
                break
    except OSError:  # not Linux
        pass
    return f"{name}, {platform.system()}"


def _table(name: str, values: Mapping[str, Value]) -> str:
    return "\n".join([f"[{name}]", *(f"{key} = {_toml(v)}" for key, v in values.items()), ""])


def _toml(value: Value) -> str:
    """One value; a JSON string is a TOML string, and so are numbers and booleans."""
    if isinstance(value, float):
        return json.dumps(float(f"{value:.6g}"))
    return json.dumps(value, ensure_ascii=False)
