"""README.md says what the runs printed: figures come from benchmarks/results, words exist."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import numpy as np
import pytest

from skinmap.neighbours.offsets import concatenate
from skinmap.neighbours.structures import find_structures

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
RESULTS = ROOT / "benchmarks" / "results"


@pytest.fixture(scope="module")
def figures():
    """The script that writes the figures."""
    spec = importlib.util.spec_from_file_location("figures", ROOT / "scripts" / "figures.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_figures_are_those_of_the_results(figures):
    assert figures.renewed(README) == README, "run `make figures`"


def test_figure_that_was_changed_by_hand_is_noticed(figures):
    changed = README.replace("4,326 of 4,326", "4,325 of 4,326")
    assert changed != README == figures.renewed(changed)


def test_page_without_the_place_for_figures_is_refused(figures):
    with pytest.raises(ValueError, match="once"):
        figures.renewed("# Skinmap\n")


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
    targets = re.findall(r"`make ([a-z-]+)`", README)
    assert {"demo", "test", "docs", "bench", "gallery", "fuzz"} <= set(targets)
    for target in targets:
        assert re.search(rf"^{target}:", rules, flags=re.MULTILINE), target
