"""Profiles: settings that `skinmap trade` recommended, in a TOML file that every command takes."""

from __future__ import annotations

import math
import stat
import tomllib
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skinmap import __version__
from skinmap.errors import DataFormatError, MissingFileError, SkinWarning, UnknownNameError
from skinmap.knobs import KNOBS, Value, tables

FORMAT = 1
MAX_BYTES = 2**16  # a profile has about one kB
ABOUT = "profile"  # the table that says where a profile is from
ABOUT_TEXTS = ("skinmap", "robot", "part", "machine")
ABOUT_NUMBERS = ("seed", "seeds")
ABOUT_KEYS = ("format", *ABOUT_TEXTS, *ABOUT_NUMBERS)
PREDICTED = "predicted"
PREDICTED_KEYS = ("seconds", "error", "unit", "pace")
WHAT = "a profile (.toml, as `skinmap trade` writes it)"


@dataclass(frozen=True, slots=True)
class Profile:
    """Settings by task, and where they were measured.

    Attributes
    ----------
    path : Path
    skinmap : str
        The version that it was measured with.
    robot, part, machine : str
        What it was measured on; empty where it does not say.
    settings : mapping of str to mapping of str to value
        Knobs by task.
    predicted : mapping of str to mapping of str to value
        By task, `seconds`, `error` and its `unit`, where it says so, and the `pace` of the machine
        then (see `skinmap.trade.pace`).
    seed, seeds : int or None
        The first seed that it was measured with, and how many.
    """

    path: Path
    skinmap: str
    robot: str
    part: str
    machine: str
    settings: Mapping[str, Mapping[str, Value]]
    predicted: Mapping[str, Mapping[str, Value]]
    seed: int | None = None
    seeds: int | None = None


def read_profile(path: Path | str) -> Profile:
    """Read a profile and check all of it.

    Parameters
    ----------
    path : path-like
        TOML; see docs/profiles.md.

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
        A table, knob or name that there is not (says which there are).

    Warns
    -----
    SkinWarning
        A profile of another version: its figures may differ.
    """
    path = Path(path)
    read = _read_toml(path)
    head = read.pop(ABOUT, None)
    about = _about(head, path)
    numbers = {key: _whole(head, key, path) for key in ABOUT_NUMBERS}
    known = tables()
    for name in read:
        if name not in known:
            raise UnknownNameError(f"table of a profile ({path})", name, [ABOUT, *known])
    settings: dict[str, Mapping[str, Value]] = {}
    predicted: dict[str, Mapping[str, Value]] = {}
    for task, entry in read.items():
        if not isinstance(entry, dict):
            raise DataFormatError(f"{task!r} must be a table [{task}], got {_kind(entry)}", path)
        knobs = dict(entry)
        if PREDICTED in knobs:
            predicted[task] = _predicted(task, knobs.pop(PREDICTED), path)
        settings[task] = _settings(task, knobs, path)
    if about["skinmap"] != __version__:
        warnings.warn(
            f"{path} was measured with Skinmap {about['skinmap']}, this is {__version__}: "
            "times and errors may differ from those predicted",
            SkinWarning,
            stacklevel=2,
        )
    return Profile(
        path,
        skinmap=about["skinmap"],
        robot=about["robot"],
        part=about["part"],
        machine=about["machine"],
        settings=settings,
        predicted=predicted,
        seed=numbers["seed"],
        seeds=numbers["seeds"],
    )


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


def _about(table: object, path: Path) -> dict[str, str]:
    """Version, robot, part and machine."""
    if not isinstance(table, dict):
        raise DataFormatError(f"no table [{ABOUT}]: expected {WHAT}", path)
    number = table.get("format")
    if isinstance(number, bool) or number != FORMAT:
        came = "none" if number is None else repr(number)
        raise DataFormatError(f"format of a profile: expected {FORMAT}, got {came}", path)
    for key, value in table.items():
        if key not in ABOUT_KEYS:
            raise UnknownNameError(f"key of [{ABOUT}] ({path})", key, ABOUT_KEYS)
        text = key in ABOUT_TEXTS
        if text != isinstance(value, str) or not isinstance(value, str | int):
            what = "text" if text else "a whole number"
            raise DataFormatError(f"[{ABOUT}] {key} must be {what}, got {_kind(value)}", path)
    if "skinmap" not in table:
        raise DataFormatError(f"[{ABOUT}] does not say which version of skinmap wrote it", path)
    return {key: str(table.get(key, "")) for key in ABOUT_TEXTS}


def _whole(head: dict[str, Any], key: str, path: Path) -> int | None:
    """A number of `[profile]` that was checked to be whole."""
    value: int | None = head.get(key)
    least, most = (1, 1000) if key == "seeds" else (0, 2**31 - 1)
    if value is not None and not least <= value <= most:
        raise DataFormatError(f"[{ABOUT}] {key} must be {least} to {most}, got {value}", path)
    return value


def _settings(task: str, table: dict[str, Any], path: Path) -> dict[str, Value]:
    known = KNOBS.get(task)
    for knob, value in table.items():
        if known is None:  # a plug-in's: its own command checks the values
            if not isinstance(value, str | int | float):
                raise DataFormatError(f"[{task}] {knob} must be a value, got {_kind(value)}", path)
            continue
        if knob not in known:
            raise UnknownNameError(f"knob of [{task}] ({path})", knob, known)
        if not known[knob].allows(value):
            words = known[knob].words()
            if isinstance(value, str):
                raise UnknownNameError(
                    f"value of [{task}] {knob} ({path})", value, words.split(", ")
                )
            raise DataFormatError(f"[{task}] {knob} = {_kind(value)}; expected {words}", path)
    return table


def _predicted(task: str, table: object, path: Path) -> dict[str, Value]:
    if not isinstance(table, dict):
        raise DataFormatError(f"[{task}.{PREDICTED}] must be a table, got {_kind(table)}", path)
    for key, value in table.items():
        if key not in PREDICTED_KEYS:
            raise UnknownNameError(f"key of [{task}.{PREDICTED}] ({path})", key, PREDICTED_KEYS)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        good = isinstance(value, str) if key == "unit" else number and 0 <= value < math.inf
        if not good:
            what = "text" if key == "unit" else "a number from 0"
            raise DataFormatError(
                f"[{task}.{PREDICTED}] {key} must be {what}, got {_kind(value)}", path
            )
    return table


def _kind(value: object) -> str:
    """A value for a message: short ones as they are, others by their kind."""
    if isinstance(value, bool | int | float | str):
        text = repr(value) if not isinstance(value, bool) else str(value).lower()
        return text if len(text) <= 40 else f"{text[:37]}..."
    return (
        "a table" if isinstance(value, dict) else "a list" if isinstance(value, list) else "a date"
    )
