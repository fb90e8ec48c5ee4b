"""The table of what is asked: its paths, its verdicts, what it says of what is missing."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

RESULTS = Path(__file__).parents[2] / "benchmarks" / "results"
CLASSIFY = RESULTS / "classify.json"
GEOMETRY = RESULTS / "geometry.json"
CALIBRATION = RESULTS / "calibration.json"
# New with this table: older files of results lack them.
NEWER = {
    "taxels", "normals_deg_median", "normals_within_15_deg_percent", "seconds", "ok",
    "ur10e",
}  # fmt: skip


def test_every_entry_of_the_table_is_complete():
    from benchmarks.harness.areas import AREAS
    from benchmarks.harness.asked import BOUNDS, asked

    entries = asked()
    assert len({(one["area"], one["what"]) for one in entries}) == len(entries)
    for one in entries:
        assert one["area"] in (*AREAS, "bench"), one
        assert sum(bound in one for bound in BOUNDS) == 1, one
        assert one["source"].startswith("issue ")
        assert ("peer" in one) == ("peer_name" in one), one


@pytest.mark.parametrize("area", ["geometry", "classify", "calibration"])
def test_the_tables_paths_exist_in_a_full_result(area):
    from benchmarks.harness.asked import asked, find

    rows = json.loads((RESULTS / f"{area}.json").read_text(encoding="utf-8"))
    for one in asked():
        if one["area"] == area and "file" not in one and not NEWER & set(map(str, one["path"])):
            path = [{k: v for k, v in key.items() if k != "one_module"} if isinstance(key, dict)
                    and area == "calibration" and key.get("one_module") is False else key
                    for key in one["path"]]  # fmt: skip
            assert list(find(rows, path)), one["what"]
            assert "peer" not in one or list(find(rows, one["peer"])), one["what"]


def test_the_tables_paths_exist_in_files_kept_from_long_runs():
    from benchmarks.harness.asked import asked, find

    for one in asked():
        if "file" in one:
            rows = json.loads((RESULTS / one["file"]).read_text(encoding="utf-8"))
            assert list(find(rows, one["path"])), one["what"]


def test_find_takes_the_rows_that_a_table_picks():
    from benchmarks.harness.asked import find, worst

    rows = {"list": [{"a": 1, "x": 2.0}, {"a": 1, "x": 3.0}, {"a": 2, "x": 9.0}, {"a": 1}]}
    assert list(find(rows, ["list", {"a": 1}, "x"])) == [2.0, 3.0]
    assert worst(find(rows, ["list", {"a": 1}, "x"]), "most") == 3.0
    assert worst(find(rows, ["list", {"a": 1}, "x"]), "least") == 2.0
    assert list(find(rows, ["nothing", {"a": 1}, "x"])) == []


def test_ratio_is_above_one_where_a_figure_is_better():
    from benchmarks.harness.asked import met, ratio

    for bound, got, limit in (("most", 2.0, 4.0), ("least", 4.0, 2.0)):
        assert met(got, limit, bound)
        assert ratio(got, limit, bound) == 2.0
        assert not met(limit, got, bound)
        assert ratio(limit, got, bound) == 0.5
    assert ratio(0, 0, "most") is None


def test_judge_says_met_short_and_why_not_measured(planted):
    rows = {row["what"]: row for row in planted["asked"]}
    assert rows["flipped triangles on the iCub"]["state"] == "met"
    assert rows["patches of the iCub"]["state"] == "falls short"
    lost = rows["50 Hz: samples lost"]
    assert lost["state"] == "not measured"
    assert "exit 1: no <network> here" in lost["note"]
    assert rows["page complete"]["note"] == "this area was left out"


def test_the_printed_table_names_what_falls_short(planted, capsys):
    from benchmarks.harness.asked import print_table

    print_table(planted["asked"])
    text = capsys.readouterr().out
    for kept in (False, True):  # of other runs, and of this one: each has its own line
        rows = [row for row in planted["asked"] if row["note"].startswith("kept in") == kept]
        assert rows
        short = sum(row["state"] == "falls short" for row in rows)
        where = "kept from runs before" if kept else "asked for and measured by this run"
        assert re.search(rf"\b{short} fall short, \d+ not measured, of {len(rows)} {where}", text)
    assert "geometry: patches of the iCub: asked 23, got 22" in text
    assert all(f"== {area}" in text for area in ("geometry", "live", "page", "bench"))


def test_a_time_that_the_quick_form_took_once_is_no_short_fall(planted):
    from benchmarks.harness.asked import judge

    geometry = planted["areas"]["geometry"]
    geometry["rows"]["icub"]["seconds"] = 9.0  # 0.6 asked for
    states = {}
    for form in ("short", "quick"):
        geometry["form"] = form
        states[form] = {row["key"]: row for row in judge(planted)}
    time, patches = "geometry.icub_prepared_s", "geometry.icub_patches"
    assert states["short"][time]["state"] == "falls short"
    assert states["quick"][time]["state"] == "not measured"
    assert states["quick"][time]["got"] == 9.0
    assert "one run" in states["quick"][time]["note"]
    assert states["quick"][patches]["state"] == "falls short"  # no time: one run says it


def test_what_stands_in_the_way_is_told_of_what_falls_short(planted):
    from benchmarks.harness.asked import doc_of, limits

    assert limits()
    assert all(text.endswith(".") for text in limits().values())
    key, text = next(iter(limits().items()))
    row = dict(planted["asked"][0], key=key, state="falls short")
    assert f"`{key}`: {text}" in doc_of(planted | {"asked": [row]})
    assert text not in doc_of(planted | {"asked": [dict(row, state="met")]})
