from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import pytest

from skinmap.errors import DataFormatError
from skinmap.validation import checked, toml_table

Count = Annotated[int, msgspec.Meta(ge=1, le=100)]


class Board(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    channels: Count
    unit: Literal["mm", "m"] = "m"


class Layout(msgspec.Struct, forbid_unknown_fields=True):
    board: Annotated[list[Board], msgspec.Meta(min_length=1)]
    rate: float | None = None


GOOD = {"board": [{"name": "a", "channels": 3}, {"name": "b", "channels": 4, "unit": "mm"}]}


def read(value: object, **how) -> Layout:
    fail = partial(DataFormatError, path=Path("l.toml"))
    return checked(value, Layout, what="the layout", fail=fail, **how)


def test_what_is_right_comes_back_typed():
    found = read({**GOOD, "rate": 3})
    assert [board.channels for board in found.board] == [3, 4]
    assert (found.rate, found.board[0].unit, found.board[1].unit) == (3.0, "m", "mm")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": 3}, r"l\.toml: \[\[board\]\] number 2: name must be text, got 3"),
        ({"name": None}, "must be text, got None"),
        ({"channels": 0}, "number 2: channels must be a whole number from 1, got 0"),
        ({"channels": 101}, "must be a whole number up to 100, got 101"),
        ({"channels": 2.5}, "must be a whole number, got 2.5"),
        ({"channels": True}, "must be a whole number, got true"),
        ({"channels": "9" * 50}, r"got '9{36}\.\.\.$"),
        ({"unit": "ell"}, "number 2: unit must be one of m, mm, got 'ell'"),
        (
            {"colour": "red"},
            r"number 2 has unknown keys: 'colour'; the keys are: name, channels, unit",
        ),
    ],
)
def test_one_line_says_key_value_and_what_was_expected(change, said):
    value = {"board": [GOOD["board"][0], {**GOOD["board"][1], **change}]}
    with pytest.raises(DataFormatError, match=said) as caught:
        read(value, called=toml_table)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ({}, "the layout lacks 'board'"),
        ({"board": []}, "the layout: board must be a list of length from 1, got a list"),
        ({"board": 3}, "board must be a list, got 3"),
        ({"board": [3]}, r"board\[0\] must be a table, got 3"),
        ({"board": [{"name": "a"}]}, r"board\[0\] lacks 'channels'"),
        ({**GOOD, "rate": "fast"}, "the layout: rate must be a number, got 'fast'"),
        ({**GOOD, "speed": 1}, "the layout has unknown keys: 'speed'; the keys are: board, rate"),
        ([], "the layout must be a table, got a list"),
    ],
)
def test_places_are_told_as_json_is_spoken_of(value, said):
    with pytest.raises(DataFormatError, match=said):
        read(value)
