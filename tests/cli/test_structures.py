"""`skinmap structures`: options, pictures, one JSON object, one line for bad input."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import SkinWarning
from skinmap.report import structure_figures


def run(*arguments: str):
    return CliRunner().invoke(cli, ["structures", *arguments])


def test_kaspar_has_the_four_structures_of_its_modules():
    result = run("kaspar", "--part", "right_hand", "--radius-mm", "auto", "--json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["structures"] == 4
    assert found["taxels"] == 144
    assert found["radius_is"] == "auto"
    assert 7.64 < found["radius_mm"] < 10.0  # between the rings of a 12-pad sheet
    assert sum(row["taxels"] for row in found["table"]) == 144
    assert found["without_structure"] == 0


def test_the_radius_lies_between_two_rings_by_itself(tmp_path):
    rows = ["channel,module,x,y,z,nx,ny,nz"]
    grid = [(8.16e-3 * i, 8.16e-3 * j) for i in range(12) for j in range(10)]
    rows += [f"{k},0,{x},{y},0,0,0,1" for k, (x, y) in enumerate(grid)]
    (tmp_path / "bare.csv").write_text("\n".join(rows) + "\n")
    trimesh.creation.box((0.3, 0.3, 1e-3)).export(tmp_path / "plate.stl")
    (tmp_path / "bare.toml").write_text(
        '[robot]\nname = "bare"\nmesh = "plate.stl"\n[[part]]\nname = "bare"\nlink = "body"\n'
        'taxels = "bare.csv"\n'
    )
    head = f'[profile]\nformat = 1\nskinmap = "{skinmap.__version__}"\n[classify]\n'
    (tmp_path / "p.toml").write_text(f"{head}rotations = 4\n")
    how = ("--profile", str(tmp_path / "p.toml"), "--json")
    found = json.loads(run(str(tmp_path / "bare.toml"), *how).stdout)
    assert found["radius_is"] == "auto"
    assert 8.16 < found["radius_mm"] < 8.16 * 2**0.5
    assert found["structures"] == 3  # inside, at a side, at a corner
    assert max(row["neighbours"] for row in found["table"]) == 4


def test_pictures_are_written_beside_the_numbers(tmp_path):
    head = f'[profile]\nformat = 1\nskinmap = "{skinmap.__version__}"\n[classify]\n'
    (tmp_path / "p.toml").write_text(head + 'distance = "geodesic"\n')
    out, profile = str(tmp_path / "out"), str(tmp_path / "p.toml")
    result = run("kaspar", "--part", "left_hand", "--out", out, "--profile", profile)
    assert result.exit_code == 0, result.output
    assert "distance geodesic" in result.output
    files = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert files == ["codewords.png", "structures.png"]
    for path in (tmp_path / "out").iterdir():
        assert path.read_bytes().startswith(b"\x89PNG")
        assert path.name in result.output


def test_pictures_of_unlike_parts_have_room_bars_beside_taxels_and_keys(tmp_path, monkeypatch):
    parts = {
        "pad": [(4.0 * i, 4.0 * j + 2.0 * (i % 2)) for i in range(10) for j in range(10)],
        "tip": [(0.0, 0.0)],
        "band": [(4.0 * i, 4.0 * j) for i in range(60) for j in range(3)],
    }
    text = '[robot]\nname = "mixed"\nmesh = "plate.stl"\n'
    for name, places in parts.items():
        rows = [f"{k},0,{x},{y},0,0,0,1" for k, (x, y) in enumerate(places)]
        lines = ["channel,module,x,y,z,nx,ny,nz", *rows]
        (tmp_path / f"{name}.csv").write_text("\n".join(lines) + "\n")
        text += f'[[part]]\nname = "{name}"\nlink = "body"\ntaxels = "{name}.csv"\nunits = "mm"\n'
    trimesh.creation.box((0.5, 0.5, 1e-3)).export(tmp_path / "plate.stl")
    (tmp_path / "mixed.toml").write_text(text)
    drawn, save = {}, structure_figures.save_figure
    monkeypatch.setattr(
        structure_figures,
        "save_figure",
        lambda figure, path: (drawn.update({path.name: figure}), save(figure, path)),
    )
    result = run(str(tmp_path / "mixed.toml"), "--out", str(tmp_path / "out"))
    assert result.exit_code == 0, result.output
    panels = drawn["structures.png"].axes[1:]
    assert [panel.get_title() for panel in panels] == list(parts)
    for panel in panels:
        assert min(np.ptp(panel.get_xlim()), np.ptp(panel.get_ylim())) >= 9.99
        low = min(y for dots in panel.collections for _, y in dots.get_offsets().tolist())
        (bar,) = panel.lines
        assert bar.get_ydata()[0] < low - 0.01 * np.ptp(panel.get_xlim())
        assert np.ptp(bar.get_xdata()) < 0.5 * np.ptp(panel.get_xlim())
    words, *maps = drawn["codewords.png"].axes
    assert len(maps) == 6  # each with its key
    heads = [one.get_text() for one in words.texts if ":" in one.get_text()]
    assert sum(int(head.split(": ")[1]) for head in heads) <= len(parts["band"])
    assert not any(head.endswith(": 0") for head in heads)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--radius-mm", "wide"), "must lie in 0.1..1000, or auto, got 'wide'"),
        (("--radius-mm", "-3"), "must lie in 0.1..1000, or auto"),
        (("--radius-mm", "nan"), "must lie in 0.1..1000, or auto"),
        (("--tolerance-mm", "0"), "write tolerance_mm = 1.5 in the table [classify] of a profile"),
        (("--rotations", "5"), "'5' is not one of '1', '4', '6'"),
    ],
)
def test_nonsense_is_refused(arguments, message):
    result = run("kaspar", "--part", "left_foot", *arguments)
    assert result.exit_code == 2
    assert message in result.output


def test_a_radius_below_the_pitch_is_warned_of():
    words = ["structures", "kaspar", "--part", "left_hand", "--radius-mm", "2"]
    with pytest.warns(SkinWarning, match="have no neighbour within 2 mm: ask for more"):
        assert CliRunner().invoke(cli, words, catch_exceptions=False).exit_code == 0
