"""Every law holds within its range, what lies outside reacts as stated, and the page says so."""

from __future__ import annotations

from pathlib import Path

import pytest
from limits.law import Law, Measured, Outside, measure, one_digit
from limits.page import LAWS, page, same_on_all_machines

PAGE = Path(__file__).parents[2] / "docs" / "limits.md"


@pytest.fixture(scope="module")
def found() -> dict[str, Measured]:
    return {}


def test_laws_have_names_of_their_own():
    assert len({law.name for law in LAWS}) == len(LAWS)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_law_holds_within_its_range_and_is_refused_outside(found, law):
    found[law.name] = measure(law)


def test_the_page_says_what_was_measured(found):
    for law in LAWS:  # where only some of the tests are run
        found.setdefault(law.name, None)
        found[law.name] = found[law.name] or measure(law)
    written = PAGE.read_text(encoding="utf-8")
    assert same_on_all_machines(written) == same_on_all_machines(page(found)), "run `make limits`"


def fails() -> None:
    raise ValueError("three")


def test_a_law_that_does_not_hold_is_named():
    law = Law("f", "scale", "stays", lambda v: v, 1.0, "planted", (0.5, 2.0))
    with pytest.raises(AssertionError, match=r"f-scale-stays at 2\.0: 2, at most 1"):
        measure(law)
    with pytest.raises(AssertionError, match="nan"):
        measure(Law("f", "scale", "stays", lambda _: float("nan"), 1.0, "planted", (1,)))


def test_another_reaction_than_the_stated_one_is_named():
    assert Outside(3, ValueError, fails, "three").check() == "`ValueError`"
    for wrong in (Outside(3, TypeError, fails), Outside(3, ValueError, fails, "four")):
        with pytest.raises(AssertionError, match="3: ValueError 'three', expected"):
            wrong.check()
    assert Outside(3, "none", lambda: None).reaction == "none"


@pytest.mark.parametrize(
    ("value", "said"),
    [(0, "0"), (1, "1"), (0.99, "1"), (3e-7, "3e-07"), (2.1, "3"), (0.31, "0.4"), (45, "5e+01")],
)
def test_deviations_are_rounded_up_to_one_digit(value, said):
    assert one_digit(value) == said


def test_only_what_was_found_may_differ_between_machines():
    one = "| `f` | scale | stays | 1 | 2 | 1e-9 | |"
    assert same_on_all_machines(one) == same_on_all_machines(one.replace("1e-9", "1e-7"))
    assert same_on_all_machines(one) != same_on_all_machines(one.replace("| 2 |", "| 3 |"))
