"""Pages that follow from results: they are what their files say, and have every figure's key."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "benchmarks" / "results"


def test_the_page_of_benchmarks_has_every_key_and_what_falls_short(planted):
    from benchmarks.harness.asked import asked, doc_of

    text = doc_of(planted)
    assert all(f"| `{one['area']}.{one['key']}` |" in text for one in asked())
    assert "| **falls short** |" in text
    assert "exit 1: no <network> here" in text


@pytest.mark.parametrize(("page", "result"), [("benchmarks", "bench"), ("needs", "needs")])
def test_a_page_is_what_its_results_say(page, result):
    from benchmarks.harness.asked import doc_of
    from benchmarks.scale.needs import page_of

    rows = json.loads((RESULTS / f"{result}.json").read_text(encoding="utf-8"))
    text = {"benchmarks": doc_of, "needs": page_of}[page](rows)
    assert (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8") == text
