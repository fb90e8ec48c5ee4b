"""Reading text files with errors that name file and line."""

from __future__ import annotations

import csv
import io
import math
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from skinmap.errors import DataFormatError, InvalidArrayError, MissingFileError

# Units of length that files may be in: the same words in manifests, options and tables.
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "inch": 0.0254}

T = TypeVar("T")
MAX_BYTES = 64 * 2**20  # the largest real table has 0.1 MB; more is another kind of file
MAX_WHOLE = 2**53  # beyond it a float has no room for every whole number
# Channels and modules are counted, so a number beyond this is damage; it also keeps sums in range.
MAX_CHANNEL = 2**31 - 1
DECIMAL_COMMA = re.compile(r"^(\s*[-+]?\d*),(\d+(?:[eE][-+]?\d+)?\s*)$")


def is_file(path: Path) -> bool:
    """Whether there is a regular file, for any path that a file may name."""
    return os.path.isfile(path)  # also where a name is too long, or has a NUL in it


def check_file(path: Path, expected: str, most_bytes: int = MAX_BYTES) -> None:
    """Refuse what is no regular file, or too large, before any of it is read.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file (`expected` says what it should be), or one above `most_bytes`.
    """
    if not is_file(path):
        raise MissingFileError(path, expected)
    size = path.stat().st_size
    if size > most_bytes:
        raise DataFormatError(
            f"{size / 2**20:.0f} MB; at most {most_bytes / 2**20:.0f} MB are read", path
        )


def read_text(path: Path, expected: str = "a text file") -> str:
    """The text of a UTF-8 file, without the byte order mark that spreadsheets put in front.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file (`expected` says what it should be), not text, or above 64 MB.
    """
    check_file(path, expected)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataFormatError(f"not a text file ({error.reason})", path) from None
    except OSError as error:
        raise DataFormatError(f"cannot be read: {error.strerror}", path) from None


@contextmanager
def in_file(path: Path, line: int | None = None) -> Iterator[None]:
    """Arrays that cannot be, as an error of the file that has them."""
    try:
        yield
    except InvalidArrayError as error:
        raise DataFormatError(str(error), path, line) from None


def read_toml(path: Path, expected: str = "a text file") -> dict[str, Any]:
    """The tables of a TOML file.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file (`expected` says what it should be), not text, or not TOML.
    """
    text = read_text(path, expected)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # huge numbers, deep nests are no TOML errors
        raise DataFormatError(f"not TOML: {str(error)[:200]}", path) from None


def csv_rows(text: str, path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line, from 1, and cells of each row of a CSV table, also as spreadsheets save it.

    Parameters
    ----------
    text : str
        Its first line tells whether `;` or tabs part the columns; then `0,5` in a cell is 0.5.
    path : Path
        For messages: what is not CSV raises DataFormatError.
    """
    head = text.partition("\n")[0]
    delimiter = next((one for one in (",", ";", "\t") if one in head), ",")
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    try:
        for row in rows:
            if delimiter != ",":
                row = [DECIMAL_COMMA.sub(r"\1.\2", cell) for cell in row]
            yield rows.line_num, row
    except csv.Error as error:
        raise DataFormatError(f"not CSV: {error}", path, rows.line_num) from None


def parse_floats(words: Sequence[str], path: Path, line: int | None) -> list[float]:
    """Finite numbers from the words of one line.

    Raises
    ------
    DataFormatError
        A word that is no finite number.
    """
    values = [_number(word, float, "a number", path, line) for word in words]
    for word, value in zip(words, values, strict=True):
        if not math.isfinite(value):
            raise DataFormatError(f"expected a finite number, got {_shown(word)}", path, line)
    return values


def digits(values: Iterable[float]) -> str:
    """Numbers of one line: the shortest digits that give the same bits back."""
    return " ".join(repr(float(value)) for value in values)


def parse_whole(
    words: Sequence[str], path: Path, line: int | None, *, most: int = MAX_WHOLE
) -> list[int]:
    """Whole numbers in -most..most from the words of one line.

    Raises
    ------
    DataFormatError
        A word that is not a whole number, or one out of range.
    """
    values = [_number(word, int, "a whole number", path, line) for word in words]
    for word, value in zip(words, values, strict=True):
        if abs(value) > most:
            raise DataFormatError(f"{_shown(word)} is beyond {most}", path, line)
    return values


def _number(word: str, kind: Callable[[str], T], called: str, path: Path, line: int | None) -> T:
    """The number of a word, unless only Python would call it one (1_000, other scripts' digits)."""
    try:
        if "_" in word or not word.isascii():
            raise ValueError(word)
        return kind(word)
    except ValueError:
        raise DataFormatError(f"expected {called}, got {_shown(word)}", path, line) from None


def _shown(word: str) -> str:
    text = word.strip()
    return repr(text if len(text) <= 40 else text[:37] + "...")
