"""The page of what is needed follows from the rows."""

from __future__ import annotations


def test_the_page_has_a_table_for_each_question():
    from needs import WHATS, page_of

    row = {"taxels": 10, "cpu_s": 0.5, "mb": 20.0, "turns": 3}
    cases = [row | {"what": what, "case": str(every[0])} for what, (every, _) in WHATS.items()]
    text = page_of({"cases": cases, "commit": "abc", "machine": {"cores": 2, "processor": "P"}})
    assert all(f"## {what.capitalize()}" in text for what in WHATS)
    assert "| 1 | 10 | 0.500 | 20 |" in text


def test_a_case_tells_time_and_memory():
    from needs import _fresh

    found = _fresh("parts loaded", 1)
    assert found["taxels"] == 250
    assert found["cpu_s"] > 0
    assert found["mb"] >= 0
