from __future__ import annotations

import pytest

from skinmap.report.present import singular
from skinmap.report.table import cell_text


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("1 touches: 1 poke", "1 touch: 1 poke"),
        ("11 touches, 1 structures over 21 taxels", "11 touches, 1 structure over 21 taxels"),
        ("0.1 samples, 1,1 taxels", "0.1 samples, 1,1 taxels"),
        ("1 people", "1 person"),
    ],
)
def test_one_thing_is_in_the_singular(line, said):
    assert singular(line) == said


def test_errors_of_rounding_are_zero_in_tables():
    assert [cell_text(cell) for cell in (2.44e-13, -3e-15, 0.0, 2.44e-5)] == [
        "0", "0", "0", "2.44e-05",
    ]  # fmt: skip
