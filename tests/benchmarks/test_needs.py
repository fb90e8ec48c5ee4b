"""The page of what is needed follows from the rows."""

from __future__ import annotations

import pytest


def rows_of(whats):
    """Planted rows: the last case of each question takes twice the time and 20 MB more."""
    row = {"taxels": 10, "triangles": None, "imports_mb": 120.0, "turns": 3}
    for what, (every, _) in whats.items():
        for case, times in ((every[0], 1), (every[-1], 2)):
            middle = 0.5 * times
            yield row | {"what": what, "case": str(case), "cpu_s": middle, "mb": 20.0 * times,
                         "spread_s": [middle - 0.1, middle, middle + 0.1]}  # fmt: skip


def test_the_page_has_a_table_for_each_question_and_says_how_much_more_it_costs(tmp_path):
    from benchmarks.scale.needs import WHATS
    from benchmarks.scale.needs_page import write_page

    machine = {"cores": 2, "processor": "P", "load_average": 0.5}
    result = {"cases": list(rows_of(WHATS)), "commit": "abc", "machine": machine}
    (tmp_path / "pictures").mkdir()
    write_page(result, tmp_path)
    text = (tmp_path / "needs.md").read_text(encoding="utf-8")
    assert all(f"## {what.capitalize()}" in text for what in WHATS)
    assert "| 1 | 10 | 0.500 | 0.400 to 0.600 | 20 |" in text
    assert "From 1 to 13: 2 times the time and +20 MB." in text
    assert (tmp_path / "pictures" / "needs.png").read_bytes().startswith(b"\x89PNG")


def test_every_question_has_a_group_of_imports_and_a_case_to_run():
    from benchmarks.scale.needs import WHATS
    from benchmarks.scale.needs_cases import GROUPS, IMPORTS, MAKE

    assert set(WHATS) == set(GROUPS) == set(MAKE)
    assert set(GROUPS.values()) == set(IMPORTS)


def test_cases_run_in_processes_of_their_own_and_tell_time_and_memory():
    from benchmarks.harness.forked import CaseError, Cases
    from benchmarks.scale.needs import PROGRAM

    with Cases(PROGRAM, "skins") as cases:
        one, three = (cases.ask("parts loaded", str(n)) for n in (1, 3))
        with pytest.raises(CaseError, match=r"parts loaded, many: ValueError"):
            cases.ask("parts loaded", "many")
    assert one["taxels"] == 250
    assert three["taxels"] > one["taxels"]
    assert min(one["cpu_s"], three["cpu_s"]) > 0
    assert min(one["mb"], three["mb"]) >= 0
