"""Profiles: settings that `skinmap trade` recommended, in a TOML file that commands take."""

from __future__ import annotations

import math
import stat
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import msgspec

from skinmap import __version__
from skinmap.errors import DataFormatError, MissingFileError, UnknownNameError, warn
from skinmap.validation import checked, shown

FORMAT = 1
MAX_BYTES = 2**16  # a profile has about one kB
PROFILE = "profile.toml"  # as `skinmap trade --out` calls it
ABOUT = "profile"  # the table on where a profile is from
PREDICTED = "predicted"  # a table of figures for people
WHAT = "a profile (.toml, as `skinmap trade` writes it)"

Value = str | int | float | bool


@dataclass(frozen=True, slots=True)
class Allowed:
    """What a knob may be set to.

    Attributes
    ----------
    names : tuple of str
        Words that it may be; with `any_name` these are examples.
    any_name : bool
        Whether plug-ins add names.
    least, most : float or None
        Range of its numbers; none for a knob that is not a number.
    whole : bool
        Whether they must be whole.
    only : tuple of int
        All numbers that there are, where they are few.
    """

    names: tuple[str, ...] = ()
    any_name: bool = False
    least: float | None = None
    most: float | None = None
    whole: bool = False
    only: tuple[int, ...] = ()

    def allows(self, value: object) -> bool:
        """Whether a value is one of these."""
        if isinstance(value, str):
            return value in self.names or (self.any_name and value.isprintable() and value != "")
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        if self.only:
            return isinstance(value, int) and value in self.only
        if self.least is None or self.most is None or (self.whole and isinstance(value, float)):
            return False
        return math.isfinite(value) and self.least <= value <= self.most

    def words(self) -> str:
        """What there is, for a message."""
        said = [", ".join(self.names)] if self.names else []
        if self.any_name:
            said.append("and those of plug-ins" if self.names else "a name")
        if self.only:
            said.append(", ".join(map(str, self.only)))
        if self.least is not None and self.most is not None:
            kind = "whole numbers" if self.whole else "numbers"
            said.append(f"{kind} from {self.least:g} to {self.most:g}")
        return "; ".join(said)


def _number(least: float, most: float, *names: str) -> Allowed:
    return Allowed(names, least=least, most=most)


def _count(least: int, most: int) -> Allowed:
    return Allowed(least=least, most=most, whole=True)


METRICS = ("edge_strain", "area", "quasi_conformal", "symmetric_dirichlet", "stretch_l2",
           "arap_energy")  # fmt: skip
KNOBS: Mapping[str, Mapping[str, Allowed]] = {
    "flatten": {
        "meshing": Allowed(("consensus", "fast", "accurate")),
        "method": Allowed(("fast", "balanced", "accurate", "auto"), any_name=True),
        "iterations": _count(1, 10_000),
        "max_seconds": _number(1e-3, 1e6),
        "max_edge_rms": _number(1e-6, 1000.0),
        "metric": Allowed(METRICS),
    },
    "classify": {
        "classifier": Allowed(any_name=True),
        "radius_mm": _number(0.1, 1000.0, "auto"),
        "tolerance_mm": _number(0.01, 1000.0),
        "words": _count(2, 250),
        "rotations": Allowed(only=(1, 4, 6)),
        "distance": Allowed(("euclidean", "geodesic")),
        "image_size": Allowed(("66x100",), any_name=True),
    },
}


@dataclass(frozen=True, slots=True)
class Profile:
    """Settings by task, and where they were measured.

    Attributes
    ----------
    path : Path
    robot, part : str
        What it was measured on; empty where it does not say.
    settings : mapping of str to mapping of str to value
        Knobs by task.
    """

    path: Path
    robot: str
    part: str
    settings: Mapping[str, Mapping[str, Value]]


def read_profile(path: Path | str) -> Profile:
    """Read a profile and check all of it.

    Parameters
    ----------
    path : path-like
        TOML; see docs/trade.md. One written by hand needs no table [profile].

    Returns
    -------
    Profile

    Raises
    ------
    MissingFileError
        No such file.
    DataFormatError
        Not TOML, too large, of another format, or a number that a knob cannot take.
    UnknownNameError
        A table, knob or name that there is not (lists those that exist).

    Warns
    -----
    SkinWarning
        A profile of another version: its figures may differ.
    """
    path = Path(path)
    read = _read_toml(path)
    by_hand = ABOUT not in read and not KNOBS.keys().isdisjoint(read)  # measured on nothing
    about = _About(FORMAT, __version__) if by_hand else _about(read.pop(ABOUT, None), path)
    for name in read:
        if name not in KNOBS:
            raise UnknownNameError(f"table of a profile ({path})", name, [ABOUT, *KNOBS])
    settings: dict[str, Mapping[str, Value]] = {}
    for task, entry in read.items():
        if not isinstance(entry, dict):
            raise DataFormatError(f"{task!r} must be a table [{task}], got {shown(entry)}", path)
        knobs = {name: value for name, value in entry.items() if name != PREDICTED}
        settings[task] = _settings(task, knobs, path)
    if about.skinmap != __version__:
        warn(
            f"{path} was measured with Skinmap {about.skinmap}, this is {__version__}: "
            "times and errors may differ from those predicted"
        )
    return Profile(path, about.robot, about.part, settings)


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise DataFormatError(f"not a file; expected {WHAT}", path)
        if status.st_size > MAX_BYTES:
            raise DataFormatError(
                f"{status.st_size / 1024:.0f} kB; a profile has at most {MAX_BYTES // 1024}", path
            )
        with path.open("rb") as file:
            return tomllib.loads(file.read(MAX_BYTES + 1).decode("utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        raise MissingFileError(path, WHAT) from None
    except UnicodeDecodeError as error:
        raise DataFormatError(f"not a text file ({error.reason})", path) from None
    except DataFormatError:
        raise
    except OSError as error:
        raise DataFormatError(f"cannot be read: {error.strerror}", path) from None
    # A path with a NUL and a number of thousands of digits are plain ValueErrors.
    except (ValueError, RecursionError) as error:
        raise DataFormatError(f"not TOML: {' '.join(str(error).split())}", path) from None


class _About(msgspec.Struct):
    """The table `[profile]`."""

    format: int
    skinmap: str
    robot: str = ""
    part: str = ""
    machine: str = ""
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**31 - 1)] | None = None
    seeds: Annotated[int, msgspec.Meta(ge=1, le=1000)] | None = None


def _about(table: object, path: Path) -> _About:
    """Where the profile is from."""
    if not isinstance(table, dict):
        raise DataFormatError(f"no table [{ABOUT}]: expected {WHAT}", path)
    number = table.get("format")
    if isinstance(number, bool) or number != FORMAT:
        came = "none" if number is None else repr(number)
        raise DataFormatError(f"format of a profile: expected {FORMAT}, got {came}", path)
    if "skinmap" not in table:
        raise DataFormatError(f"[{ABOUT}] lacks the version of skinmap that wrote it", path)
    for key in table:
        if key not in _About.__struct_fields__:
            raise UnknownNameError(f"key of [{ABOUT}] ({path})", key, _About.__struct_fields__)
    return checked(table, _About, what=f"[{ABOUT}]", fail=partial(DataFormatError, path=path))


def _settings(task: str, table: dict[str, Any], path: Path) -> dict[str, Value]:
    known = KNOBS[task]
    for knob, value in table.items():
        if knob not in known:
            raise UnknownNameError(f"knob of [{task}] ({path})", knob, known)
        if not known[knob].allows(value):
            words = known[knob].words()
            if isinstance(value, str):
                raise UnknownNameError(
                    f"value of [{task}] {knob} ({path})", value, words.split(", ")
                )
            raise DataFormatError(f"[{task}] {knob} = {shown(value)}; expected {words}", path)
    return table
