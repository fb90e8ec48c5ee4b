"""The page of what is needed follows from the rows; each case has a process of its own."""

from __future__ import annotations

import pytest


def rows_of(whats):
    """Planted rows: the last case of each question takes twice the time and 20 MB more."""
    row = {"taxels": 10, "imports_mb": 120.0, "turns": 3}
    for what, (every, _) in whats.items():
        for case, times in ((every[0], 1), (every[-1], 2)):
            middle = 0.5 * times
            yield row | {"what": what, "case": str(case), "cpu_s": middle, "mb": 20.0 * times,
                         "spread_s": [middle - 0.1, middle, middle + 0.1]}  # fmt: skip


def test_the_page_has_a_table_for_each_question():
    from benchmarks.scale.needs import WHATS, page_of

    machine = {"cores": 2, "processor": "P", "load_average": 0.5}
    text = page_of({"cases": list(rows_of(WHATS)), "commit": "abc", "machine": machine})
    assert all(f"## {what.capitalize()}" in text for what in WHATS)
    assert "| 1 | 10 | 0.500 | 0.400 to 0.600 | 20 |" in text


def test_every_question_has_a_case_to_run():
    from benchmarks.scale.needs import MAKE, WHATS

    assert set(WHATS) == set(MAKE)


def test_cases_run_in_processes_of_their_own_and_tell_time_and_memory():
    from benchmarks.scale.needs import apart

    one, three = (apart("parts loaded", n) for n in (1, 3))
    with pytest.raises(TypeError):
        apart("parts loaded", "many")
    assert one["taxels"] == 250
    assert three["taxels"] > one["taxels"]
    assert min(one["cpu_s"], three["cpu_s"]) > 0
    assert min(one["mb"], three["mb"]) >= 0
