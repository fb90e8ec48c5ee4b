"""Reading text files with errors that name file and line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from skinmap.errors import DataFormatError, MissingFileError


def read_text(path: Path) -> str:
    """The text of a UTF-8 file.

    Raises
    ------
    MissingFileError, DataFormatError
        No such file, or not text.
    """
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise MissingFileError(path, "a text file") from None
    except UnicodeDecodeError as error:
        raise DataFormatError(f"not a text file ({error.reason})", path) from None
    except OSError as error:
        raise DataFormatError(f"cannot be read: {error.strerror}", path) from None


def parse_floats(words: Sequence[str], path: Path, line: int) -> list[float]:
    """Finite numbers from the words of one line.

    Raises
    ------
    DataFormatError
        A word that is no finite number.
    """
    values = []
    for word in words:
        try:
            value = float(word)
        except ValueError:
            raise DataFormatError(f"expected a number, got {word.strip()!r}", path, line) from None
        if not math.isfinite(value):
            raise DataFormatError(f"expected a finite number, got {word.strip()!r}", path, line)
        values.append(value)
    return values
