"""Saved views: there and back, and every way to be damaged."""

from __future__ import annotations

import json

import pytest

from skinmap.errors import DataFormatError, MissingFileError, OutputError
from viewer.interaction.view_file import SavedView, free_name, load_view, save_view

VIEW = SavedView(
    "iCub", (1.0, 0.2, 0.1), (0.0, 0.0, 0.1), (0.0, 0.0, 1.0), 22.0, "still", "health", "discs",
    "torso", {"torso": (3, 4)},
)  # fmt: skip


def test_view_comes_back_as_it_was_saved(tmp_path):
    path = save_view(VIEW, tmp_path / "view.json")
    assert load_view(path) == VIEW
    assert json.loads(path.read_text())["version"] == 1


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"version": 2}, "view of version 2; this Skinmap reads version 1"),
        ({"format": "other"}, "no saved view"),
        ({"camera": None}, '"camera" expected'),
        ({"camera": {"position": [1, 2]}}, r"length 3, got 2 - at `\$.position`"),
        ({"style": "balls"}, r"\^\(surface\|discs\)\$' - at `\$.style`"),
        ({"layer": 3}, r"Expected `str`, got `int` - at `\$.layer`"),
        ({"selection": {"torso": [-1]}}, "Expected `int` >= 0"),
        ({"selection": [1]}, r"Expected `object`, got `array` - at `\$.selection`"),
    ],
)
def test_damaged_view_is_refused_in_one_line(tmp_path, change, match):
    path = save_view(VIEW, tmp_path / "view.json")
    content = json.loads(path.read_text()) | change
    path.write_text(json.dumps(content))
    with pytest.raises(DataFormatError, match=match) as error:
        load_view(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [("angle", 0), ("angle", "wide"), ("mode", "wild"), ("focus", [1.0, 0.2, 0.1]),
     ("up", [0, 0, 0]), ("position", [float("nan"), 0, 0]), ("position", [True, 0, 0]),
     ("position", [10**400, 0, 0]), ("angle", 10**400)],
)  # fmt: skip
def test_impossible_camera_is_refused(tmp_path, name, value):
    path = save_view(VIEW, tmp_path / "view.json")
    content = json.loads(path.read_text())
    content["camera"][name] = value
    path.write_text(json.dumps(content))
    with pytest.raises(DataFormatError, match="damaged view"):
        load_view(path)


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", "null", "[" * 100_000, "\x00\xff"])
def test_what_is_no_view_at_all_is_refused(tmp_path, text):
    path = tmp_path / "view.json"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(DataFormatError):
        load_view(path)


def test_missing_and_unwritable_views_are_told(tmp_path):
    with pytest.raises(MissingFileError, match="a view saved by the viewer"):
        load_view(tmp_path / "none.json")
    with pytest.raises(OutputError, match="cannot write"):
        save_view(VIEW, tmp_path / "no" / "view.json")


def test_new_files_never_replace_old_ones(tmp_path):
    first = free_name(tmp_path, "skinmap", ".png")
    first.write_text("")
    second = free_name(tmp_path, "skinmap", ".png")
    assert (first.name, second.name) == ("skinmap-001.png", "skinmap-002.png")
    with pytest.raises(OutputError, match="no folder"):
        free_name(tmp_path / "none", "skinmap", ".png")
