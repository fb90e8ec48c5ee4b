"""Pages show what the runs printed, and how old that is: figures come from benchmarks/results."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.harness.record import changed, today
from skinmap.neighbours.offsets import concatenate
from skinmap.neighbours.structures import find_structures

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
MOST_LINES = 120  # of the README
RESULTS = ROOT / "benchmarks" / "results"
# A figure is of today where the code that ran for it is: a share of it may have changed, which the
# page says. What was kept before the code was can only be made anew: their number may only fall.
MOST_CHANGED = 0.3
WITHOUT_CODE = 8


@pytest.fixture(scope="module")
def figures():
    """The script that writes the figures."""
    spec = importlib.util.spec_from_file_location("figures", ROOT / "scripts" / "figures.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def code():
    """All pieces of the code as it is."""
    return today()


@pytest.fixture(scope="module")
def shown(figures):
    """Names of the results that README and docs show."""
    names = {n for one in figures.PAGES.values() for _, own in one.values() for n in own}
    for page in figures.pages():
        names |= {n for one in figures.MADE.finditer(page.read_text()) for n in one[2].split(", ")}
    return sorted(names)


def test_figures_are_those_of_the_results(figures, code):
    for name, sections in figures.PAGES.items():
        page = (ROOT / name).read_text(encoding="utf-8")
        assert figures.renewed(page, code, sections) == page, f"{name}: run `make figures`"


def test_readme_is_short():
    assert len(README.splitlines()) <= MOST_LINES


def test_pages_tell_the_age_of_their_results(figures, code):
    assert {page.stem for page in figures.pages()} >= {"evaluation", "images", "touches"}
    for page in figures.pages():
        text = page.read_text(encoding="utf-8")
        assert figures.dated(text, code) == text, f"{page.name}: run `make figures`"


def test_no_result_is_shown_whose_code_is_gone(shown, code):
    """A commit that changes much of what ran for a figure has to make that figure anew."""
    shares = {name: changed(json.loads((RESULTS / f"{name}.json").read_text()), code)
              for name in shown}  # fmt: skip
    old = {name: share for name, share in shares.items() if share is not None}
    assert {name: share for name, share in old.items() if share > MOST_CHANGED} == {}
    assert len(shares) - len(old) <= WITHOUT_CODE


def test_age_is_told_as_it_is(figures, tmp_path):
    made = {"commit": "abc1234", "clean": True, "date": "2026-11-23", "code": "aa bb cc dd"}
    (tmp_path / "one.json").write_text(json.dumps({"made": made}))
    (tmp_path / "two.json").write_text(json.dumps({**made, "clean": False, "code": ""}))
    tables = {"measured_at": {"touch": "abc1234", "wiring": "def5678"}}
    (tmp_path / "three.json").write_text(json.dumps(made | tables))
    same, other = frozenset(["aa", "bb", "cc", "dd", "ee"]), frozenset(["aa", "bb", "cc"])
    assert figures.age(["one"], same, tmp_path) == "Made: `one` at abc1234 (2026-11-23)."
    assert figures.age(["three"], same, tmp_path) == (
        "Made: `three` at abc1234 (2026-11-23, some of its tables at def5678)."
    )
    assert figures.age(["two", "one"], other, tmp_path) == (
        "Made: `one` at abc1234 (2026-11-23), with more than a twentieth of their code changed "
        "since; `two` at abc1234 (2026-11-23, with changes), without a record of the code that ran."
    )
    assert changed({"made": made}, other) == 0.25
    page = "<!-- made: one -->\nolder words\nmore\n"
    assert figures.dated(page, same, tmp_path) == (
        "<!-- made: one -->\nMade: `one` at abc1234 (2026-11-23).\nmore\n"
    )


def test_figure_that_was_changed_by_hand_is_noticed(figures, code):
    other = README.replace("4,326 of 4,326", "4,325 of 4,326")
    assert other != README == figures.renewed(other, code, figures.PAGES["README.md"])


def test_page_without_the_place_for_figures_is_refused(figures, code):
    with pytest.raises(ValueError, match="once"):
        figures.renewed("# Skinmap\n", code, figures.SECTIONS)


def test_no_other_figure_is_written_by_hand(figures):
    """A number with a unit outside the block that is made could outlive the run it came from."""
    prose = re.sub(r"```.*?```|^    .*?$|`[^`]*`", "", README, flags=re.DOTALL | re.MULTILINE)
    prose = figures.BETWEEN.sub("", prose)
    assert not re.findall(r"\d[\d.,]*\s?(?:%|ms|µs|s|mm|MB|GB|times)\b", prose)


def test_numbers_of_the_whole_icub_are_what_the_code_still_gives(icub, prepared):
    """Results are kept from a run; what takes a second only is done again."""
    kept = json.loads((RESULTS / "demo.json").read_text())
    skins = {part: prepared(part) for part in icub.parts}
    charts = [chart for skin in skins.values() for chart in skin.flat.charts]
    strain = [100.0 * chart.distortion.edge_rms for chart in charts]
    hoods = concatenate([skin.hoods for skin in skins.values()])
    assert kept["taxels"] == sum(len(skin) for skin in skins.values())
    assert kept["meshed_taxels"] == sum(int((one.patches >= 0).sum()) for one in skins.values())
    assert kept["patches"] == len(charts)
    assert kept["flips"] == sum(chart.distortion.flips for chart in charts)
    found = {"plain": 1, "rotated": 6}
    found = {name: len(find_structures(hoods, rotations=n).prototypes) for name, n in found.items()}
    assert kept["structures"] == found
    # The README shows two digits; solvers of another machine may differ in the tenth.
    assert kept["edge_rms_percent"]["median"] == pytest.approx(np.median(strain), abs=5e-3)
    assert kept["edge_rms_percent"]["max"] == pytest.approx(max(strain), abs=5e-3)


def test_every_make_target_named_in_a_line_exists():
    rules = (ROOT / "Makefile").read_text()
    pages = [README, (ROOT / "docs" / "quickstart.md").read_text(encoding="utf-8")]
    targets = re.findall(r"(?:`|^    )make ([a-z-]+)", "\n".join(pages), flags=re.MULTILINE)
    assert {"demo", "test", "docs", "bench", "help"} <= set(targets)
    for target in targets:
        assert re.search(rf"^{target}:", rules, flags=re.MULTILINE), target
