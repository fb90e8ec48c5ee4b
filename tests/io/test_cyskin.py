"""CySkin files: read, written, and every fault of theirs named."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import DataFormatError
from skinmap.flat.costs import compare_drawing
from skinmap.flat.flat_map import flatten
from skinmap.io.flat_maps.sources import read_tactile_maps
from skinmap.io.robots.manifest import data_folder
from skinmap.io.taxels.cyskin import (
    ParentFrame,
    columns_of,
    file_faults,
    has_channel,
    read_cyskin,
    set_faults,
    write_cyskin,
)
from skinmap.io.taxels.taxel_table import read_taxels
from skinmap.skin.skin import skin_from_points
from skinmap.skin.taxels import NO_ID
from skinmap.surface.surface_mesh import build_surface

TAXELS = data_folder() / "ur10e_cyskin" / "taxels"
PUBLISHED = Path(__file__).parents[3] / "shared" / "data" / "cyskin"
# What is wrong with each of the published files, beside the placeholder frame that all have.
FAULTS = {
    "ur10e/ur10e_link1_patch1.json": ["info.name is 'UR10_link2'"],
    "ur10e/ur10e_link1_patch2.json": ["2 maps have the key 1"],
    "ur10e/ur10e_link1_patch3.json": ["the id 1 is the only one of its module"],
    "ur10e/ur10e_link1_patch4.json": [],
    "ur10e/ur10e_link2_patch1.json": ["the id 1 is the only one of its module"],
    "ur10e/ur10e_link2_patch2.json": [],
    "ur10e/ur10e_link2_patch3.json": ["the id 1 is the only one of its module"],
    "ur10e/ur10e_link2_patch4.json": ["5 taxels have the id 1"],
    "gesture_patch/curved_gesture_patch.json": ["8 taxels have the id 0"],
    "handles/collaborate_handle_1_ale.json": ["2 taxels have the id 38433"],
}


@pytest.fixture(scope="module")
def shape():
    return read_cyskin(TAXELS / "link1.json")


@pytest.fixture
def document():
    return json.loads((TAXELS / "link2.json").read_text())


def saved(tmp_path, document, name="skin.json"):
    path = tmp_path / name
    path.write_text(json.dumps(document))
    return path


def said(tmp_path, document, name="skin.json"):
    return file_faults(read_cyskin(saved(tmp_path, document, name)), name)


def test_written_files_are_read_back_bit_by_bit(shape, tmp_path):
    frames = (ParentFrame("forearm", np.arange(16.0).reshape(4, 4) + 0.1),)
    whole = dataclasses.replace(shape, frames=frames, positions=shape.positions / 3.0)
    write_cyskin(whole, tmp_path / "t.json")
    again = read_cyskin(tmp_path / "t.json")
    assert again.name == whole.name
    for name in ("ids", "positions", "normals", "faces"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))
    np.testing.assert_array_equal(again.frames[0].transform, frames[0].transform)
    np.testing.assert_array_equal(again.maps[0].uv, whole.maps[0].uv)
    write_cyskin(again, tmp_path / "u.json")
    assert (tmp_path / "u.json").read_bytes() == (tmp_path / "t.json").read_bytes()


def test_tables_have_rows_for_channels_and_boards_for_modules(shape):
    table = read_taxels(TAXELS / "link1.json")
    assert table.channels.tolist() == list(range(642))
    sizes = np.unique(table.modules, return_counts=True)[1]
    assert len(sizes) == 60
    assert set(sizes.tolist()) == {10, 11}
    np.testing.assert_array_equal(table.ids, shape.ids)


@pytest.mark.parametrize(
    ("patch", "unwired"), [("link1_patch1", 0), ("link1_patch3", 1), ("link2_patch4", 5)]
)
def test_taxels_whose_id_is_not_their_own_keep_the_place_and_lose_the_channel(patch, unwired):
    ids = np.loadtxt(TAXELS / f"{patch}.ids", dtype=np.int64)
    skin = read_cyskin(TAXELS / f"{patch[:5]}.json")
    table = dataclasses.replace(skin, ids=ids).table()
    assert len(table) == len(ids)
    assert (table.ids == NO_ID).sum() == len(table.unwired) == unwired
    # The module of a taxel without an id is one of the boards, and none grows beyond the largest.
    assert np.unique(table.modules, return_counts=True)[1].max() <= 11
    assert len(np.unique(table.modules)) == len(np.unique(skin.table().modules))


def test_a_lone_id_counts_where_all_are_alone():
    assert has_channel(np.array([16, 32, 48])).all()
    assert has_channel(np.array([7, 7, 9, -1])).tolist() == [False, False, True, False]


def test_columns_of_a_recording_find_their_taxels(shape):
    table = shape.table()
    recorded = [*shape.ids[5:9].tolist(), 12, shape.ids[0], 77, 77]
    columns, unplaced, twice = columns_of(recorded, table)
    assert columns[5:9].tolist() == [0, 1, 2, 3]
    assert columns[0] == 5
    assert (columns >= 0).sum() == 5
    assert unplaced.tolist() == [12]
    assert twice.tolist() == [77]
    assert (columns_of([], table)[0] == -1).all()


def test_faults_of_published_files_are_all_named():
    if not PUBLISHED.is_dir():
        pytest.skip("the published CySkin files are not here")
    files = {name: read_cyskin(PUBLISHED / name) for name in FAULTS}
    together = set_faults(files)
    for name, expected in FAULTS.items():
        found = file_faults(files[name], Path(name).name)
        assert sum("tf_matrix is a placeholder" in text for text in found) == 1
        own = [text for text in found if "tf_matrix" not in text]
        assert [text[: len(want)] for text, want in zip(own, expected, strict=True)] == expected
        mates = [text for text in together[name] if "the same place" in text]
        assert len(mates) == (0 if "handle" in name else 1)
    # The gesture patch has the shape of link 1: five files at one place.
    assert together["ur10e/ur10e_link1_patch1.json"][0].count("json") == 4


def test_faults_that_are_made_are_named(document, tmp_path):
    assert said(tmp_path, document) == ["no parent frame: the place of the skin is missing"]
    skin, (one,) = document["skin"], document["tactile_maps"]
    rotation = [0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.1, 0.0, 0.0, 1.0]
    skin["parent_frames"] = [{"name": "forearm_link", "tf_matrix": rotation}]
    assert said(tmp_path, document) == []
    rows = np.array(rotation).reshape(4, 4).T.ravel().tolist()
    skin["parent_frames"][0]["tf_matrix"] = rows
    assert "not written by columns" in said(tmp_path, document)[0]
    skin["parent_frames"][0]["tf_matrix"] = [2.0, *rotation[1:]]
    assert "not a rigid motion" in said(tmp_path, document)[0]
    skin["parent_frames"][0]["tf_matrix"] = rotation
    assert (
        "state link2"
        in said(tmp_path, {**document, "info": {**document["info"], "name": "link7"}})[0]
    )
    assert said(tmp_path, document, "left_link3.json") == []  # its own name and its maps agree
    skin["n_taxels"] = 640
    assert said(tmp_path, document) == ["the skin is stated to have 640 taxels and has 524"]
    skin["n_taxels"] = 524
    turned = [{**taxel, "n": [-value for value in taxel["n"]]} for taxel in skin["taxels"]]
    inward = {**document, "skin": {**skin, "taxels": turned}}
    assert "disagree with the faces by 180 degrees" in said(tmp_path, inward)[0]
    other = {**one, "taxels": one["taxels"][:-1], "faces": [], "n_taxels": 523, "n_faces": 0}
    mixed = {**document, "tactile_maps": [one, other]}
    assert any("of another skin: 523 taxels" in text for text in said(tmp_path, mixed))
    with pytest.warns(UserWarning, match="left out maps of another skin"):
        assert list(read_tactile_maps([saved(tmp_path, mixed)])) == ["ur10e_link2_isomap"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["info"].update(file_version="1"), "version '1'; version 2 is read"),
        (lambda d: d.pop("info"), "lacks 'info'"),
        (lambda d: d["skin"]["taxels"][3].update(x=[0.0, 1.0]), r"x must be .*length from 3"),
        (lambda d: d["skin"]["taxels"][3].update(id="7"), r"id must be a whole number, got '7'"),
        (lambda d: d["skin"]["taxels"][3].update(x=[0.0, 1.0, 1e999]), "Infinity|infinity"),
        (lambda d: d["skin"]["faces"].append([0, 1, 524]), r"names rows \[0, 1, 524\]"),
        (lambda d: d["skin"]["taxels"].clear(), "taxels must be"),
        (lambda d: (d.pop("skin"), d.pop("tactile_maps")), "neither a skin nor tactile maps"),
    ],
)
def test_wrong_files_are_refused_in_one_line(document, tmp_path, change, message):
    change(document)
    with pytest.raises(DataFormatError, match=message) as error:
        read_cyskin(saved(tmp_path, document))
    assert "\n" not in str(error.value)


def test_maps_alone_and_skins_alone_are_read(document, tmp_path):
    maps = saved(
        tmp_path, {**document, "skin": None, "tactile_maps": {"a": document["tactile_maps"][0]}}
    )
    assert len(read_cyskin(maps)) == 0
    with pytest.raises(DataFormatError, match="maps only, no skin"):
        read_taxels(maps)
    assert len(read_tactile_maps([maps], 524)["ur10e_link2_isomap"]) == 524
    with pytest.raises(DataFormatError, match="only of another skin"):
        read_tactile_maps([maps], 525)
    with pytest.raises(DataFormatError, match="of another skin: 524 taxels, not 642"):
        read_tactile_maps([TAXELS / "link2.json"], 642)
    document.pop("tactile_maps")
    with pytest.raises(DataFormatError, match="without tactile maps"):
        read_tactile_maps([saved(tmp_path, document)])


def test_their_map_costs_what_it_costs_whatever_its_scale_and_side(shape):
    mesh = build_surface(skin_from_points(shape.positions, shape.normals), faces=shape.faces)
    (chart,) = flatten(mesh).charts
    assert chart.distortion.flips == 0
    assert chart.distortion.edge_rms <= 1e-3
    rows = np.arange(len(shape))
    for change in ([1.0, 1.0], [-3.0, 3.0]):
        drawn = compare_drawing(chart, mesh.vertices, rows, rows, shape.maps[0].uv * change)
        assert drawn.distortion is not None
        # Published with the file; the planted control is that ours on the same mesh costs 0.09.
        assert 100.0 * drawn.distortion.edge_rms == pytest.approx(8.94, abs=0.01)
        assert drawn.mirrored == (change[0] < 0)


@pytest.mark.parametrize("meshing", [[], ["--meshing", "consensus"]])
def test_a_handle_is_laid_flat_better_than_its_own_map(meshing):
    path = PUBLISHED / "handles" / "collaborate_handle_1_ale.json"
    if not path.is_file():
        pytest.skip("the published handle is not here")
    words = ["flatten", str(path), "--compare", "theirs", "--json", *meshing]
    found = json.loads(CliRunner().invoke(cli, words, catch_exceptions=False).stdout)
    (row,), theirs = found["patches"], found["compare"]
    assert row["flips"] == 0
    assert row["edge_rms_percent"] <= 0.5
    assert min(one["edge_rms_percent"] for one in theirs) > 8.5


def test_flatten_compares_with_theirs(tmp_path):
    words = ["flatten", str(TAXELS / "link2.json"), "--compare", "theirs", "--json"]
    found = json.loads(CliRunner().invoke(cli, words, catch_exceptions=False).stdout)
    assert found["meshing"] is None
    (row,), (theirs,) = found["patches"], found["compare"]
    assert row["flips"] == theirs["flips"] == 0
    assert row["edge_rms_percent"] <= 0.1
    assert theirs["with"] == "ur10e_link2_isomap"
    assert theirs["edge_rms_percent"] == pytest.approx(8.16, abs=0.01)
    ours = CliRunner().invoke(cli, ["flatten", "kaspar", "--compare", "theirs"])
    assert isinstance(ours.exception, skinmap.SkinError)
    assert "flat maps in the files of KASPAR" in str(ours.exception)


@pytest.mark.parametrize(
    ("robot", "part"), [("kaspar", "left_foot"), ("ur10e-cyskin", "forearm_2")]
)
def test_exported_parts_come_back_with_their_boards_and_our_map(robot, part, tmp_path):
    path = tmp_path / "t.json"
    words = ["export", robot, "--part", part, "--format", "cyskin", "-o", str(path)]
    assert CliRunner().invoke(cli, words).exit_code == 0
    skin = skinmap.load_robot(robot).skin(part)
    table = read_taxels(path)
    np.testing.assert_allclose(table.positions, skin.positions, rtol=0, atol=1e-12)
    together = skin.modules[:, None] == skin.modules
    wired = table.ids != NO_ID
    again = (table.modules[:, None] == table.modules)[wired][:, wired]
    np.testing.assert_array_equal(again, together[wired][:, wired])
    (theirs,) = read_tactile_maps([path]).values()
    mesh = skinmap.build_surface(skin)
    for chart in skinmap.flatten(mesh).charts:
        drawn = compare_drawing(
            chart, mesh.vertices[chart.taxels], chart.taxels, theirs.channels, theirs.xy
        )
        assert drawn.distance < 1e-9


def test_inspect_names_faults_of_files_one_by_one_and_together(document, tmp_path):
    paths = [str(saved(tmp_path, document, f"link2_{k}.json")) for k in (1, 2)]
    found = json.loads(CliRunner().invoke(cli, ["inspect", *paths, "--json"]).stdout)
    assert [row["taxels"] for row in found["parts"]] == [524, 524]
    one, other = (row["warnings"] for row in found["parts"])
    assert "stands at the same place as link2_2.json" in one
    assert "524 ids are also those of taxels of link2_1.json" in other
    refused = CliRunner().invoke(cli, ["inspect", paths[0], "icub"])
    assert refused.exit_code == 2
    assert "several tables, or one robot" in refused.stderr


def test_three_faces_at_an_edge_are_named_with_the_way_to_mesh_anew(tmp_path):
    held = json.loads(next(TAXELS.glob("*.json")).read_text())
    skin = held["skin"]
    first, second, _ = skin["faces"][0]
    skin["faces"].append([second, first, len(skin["taxels"]) - 1])
    skin["n_faces"] = len(skin["faces"])
    path = tmp_path / "three.json"
    path.write_text(json.dumps(held))
    refused = CliRunner().invoke(cli, ["flatten", str(path), "--json"])
    assert isinstance(refused.exception, DataFormatError)
    assert re.search(r"lies in 3 faces.*--meshing consensus", str(refused.exception))
    laid = CliRunner().invoke(cli, ["flatten", str(path), "--meshing", "consensus", "--json"])
    assert laid.exit_code == 0, laid.output
    assert [one["flips"] for one in json.loads(laid.stdout)["patches"]] == [0]
