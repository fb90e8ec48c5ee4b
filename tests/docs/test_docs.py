"""The documents do what they say: tutorials draw, examples are installed and run, links lead on."""

from __future__ import annotations

import importlib
import importlib.util
import json
import re
import runpy
import subprocess
import sys
import zipfile
from pathlib import Path

import click
import pytest

import skinmap
from skinmap.cli.main import cli

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PLUGINS = DOCS / "examples" / "plugins"
TUTORIALS = sorted((DOCS / "tutorials").glob("*.py"))
SCHEMAS = sorted((DOCS / "schemas").glob("*.json"))
THEORY = re.split(r"^(?=## )", (DOCS / "theory.md").read_text(encoding="utf-8"), flags=re.M)[1:]
PAGES = sorted([*DOCS.rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
FILE = r"\.(?:csv|db3|dxf|h5|json|log|mcap|md|np[yz]|parquet|pdf|png|py|stl|svg|toml|txt|xml|ini)$"
BUILD = "import sys; from setuptools import build_meta; build_meta.build_wheel(sys.argv[1])"
USE = """
import sys
sys.path.insert(0, sys.argv[1])
from pathlib import Path
import skinmap
from skinmap.errors import DataFormatError
from skinmap.io.taxels.taxel_table import read_taxels
from skinmap.live import check_source, open_source

board = Path(sys.argv[1]) / "board.mm"
board.write_text("0/1 0 0 41\\n0/0 6.5 0 41\\n")
table = read_taxels(board, format="millimetres")
board.write_text("0/1 here\\n")
try:
    read_taxels(board, format="millimetres")
except DataFormatError as error:
    line = error.line
robot = skinmap.load_robot("icub")
check_source(
    lambda: open_source("breathing:0.6", robot=robot, parts=["left_hand"]), samples=20, seconds=60
)
print(table.channels.tolist(), [round(x, 6) for x in table.positions[0].tolist()], line)
"""


@pytest.mark.parametrize("script", TUTORIALS, ids=lambda path: path.stem)
def test_tutorial_runs_and_draws_the_pictures_of_its_page(script, tmp_path, monkeypatch, capsys):
    if script.stem in ("see_touches_live", "see_a_stroke_live"):
        from skinmap.display import require_opengl

        require_opengl()
    monkeypatch.setattr(sys, "argv", [str(script), str(tmp_path)])
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script), run_name="__main__")
    shown = re.findall(r"\(\.\./pictures/tutorials/(\S+?)\)", script.read_text())
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(shown)
    assert all((tmp_path / name).stat().st_size > 10_000 for name in shown)
    assert all((DOCS / "pictures" / "tutorials" / name).is_file() for name in shown)
    assert capsys.readouterr().out.strip()


def test_every_picture_is_shown_by_a_page():
    pages = [*PAGES, *TUTORIALS]
    shown = {
        (page.parent / link).resolve()
        for page in pages
        for link in re.findall(r"!\[[^]]*\]\(([^)\s]+)\)", page.read_text(encoding="utf-8"))
    }
    assert set((DOCS / "pictures").rglob("*.png")) <= shown


def test_robot_of_the_example_is_meshed_whole():
    robot = skinmap.load_robot(str(DOCS / "examples" / "robot" / "robot.toml"))
    skin = robot.skin("forearm")
    mesh = skinmap.build_surface(skin)
    assert set(mesh.faces.ravel()) == set(range(len(skin))) == set(range(224))
    # Taxels stand 1 mm above a cylinder of 40 mm about z: outward is away from its axis.
    outward = skin.positions * [1, 1, 0] / 0.041
    assert (outward * skin.normals).sum(axis=1).min() > 0.9
    assert skinmap.flatten(mesh).flips == 0


def test_reader_and_source_of_the_example_are_installed_and_run(tmp_path):
    """The wheel is unpacked as an installer would; pip itself costs five times as much."""
    source, target = tmp_path / "source", tmp_path / "installed"
    source.mkdir()  # a copy: building leaves folders beside the source
    for file in PLUGINS.glob("*.*"):
        (source / file.name).write_text(file.read_text())
    build = [sys.executable, "-c", BUILD, str(tmp_path)]
    done = subprocess.run(build, cwd=source, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(target)
    run = [sys.executable, "-c", USE, str(target)]
    result = subprocess.run(run, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stderr
    assert result.stdout.split("]")[0] == "[0, 1"
    assert "[0.0065, 0.0, 0.041]" in result.stdout
    assert result.stdout.split()[-1] == "1"  # the line that is wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_local_links_of_a_page_lead_to_files(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if not re.match(r"[a-z]+:", link) and not link.startswith("#"):
            assert (page.parent / link.partition("#")[0]).exists(), link


@pytest.mark.parametrize("file", SCHEMAS, ids=lambda path: path.stem)
def test_schema_is_one_and_every_key_of_it_is_in_the_page(file):
    from jsonschema import Draft202012Validator

    schema = json.loads(file.read_text())
    Draft202012Validator.check_schema(schema)
    page = (DOCS / "json.md").read_text()
    kinds = schema.get("anyOf", [schema])
    missing = [key for kind in kinds for key in kind["properties"] if f"`{key}`" not in page]
    assert not missing
    assert not Draft202012Validator(schema).is_valid({})  # some keys are always there


def test_every_command_with_json_has_a_schema():
    names = [name for name, command in commands(cli) if takes_json(command)]
    missing = {"-".join(name) for name in names} - {file.stem for file in SCHEMAS}
    assert not missing


def commands(group, above=()):
    """All commands by the words that call them."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            yield from commands(command, (*above, name))
        else:
            yield (*above, name), command


def takes_json(command):
    return any("--json" in parameter.opts for parameter in command.params)


@pytest.mark.parametrize(
    "kept", sorted((ROOT / "benchmarks" / "results").glob("evaluation_*.json"))
)
def test_kept_evaluations_keep_their_schema(kept):
    """The long protocols run in no test; what they printed is kept."""
    from jsonschema import Draft202012Validator

    schema = json.loads((DOCS / "schemas" / "evaluate.json").read_text())
    result = json.loads(kept.read_text())
    del result["made"]
    Draft202012Validator(schema).validate(result)


def test_every_folder_with_formulas_has_a_section_of_theory():
    folders = [path.parent for path in (ROOT / "skinmap").glob("*/__init__.py")]
    # Commands and how they show results; tasks handed out.
    plain = {"cli", "commands", "parallel", "report"}
    names = {f"skinmap.{folder.name}" for folder in folders if folder.name not in plain}
    assert names | {"calibration", "viewer"} == {
        re.search(r"\(`([\w.]+)`\)", section)[1] for section in THEORY
    }


@pytest.mark.parametrize("text", THEORY, ids=lambda text: text.partition("\n")[0])
def test_theory_names_code_that_exists_and_sources_with_a_year(text):
    for name in re.findall(r"`((?:skinmap|calibration|viewer)(?:\.[a-z_]+)+)`", text):
        assert importlib.util.find_spec(name) is not None, name
    sources = text.partition("### Sources")[2].partition("The interface")[0]
    for source in re.split(r"^- ", sources, flags=re.MULTILINE)[1:]:
        assert re.search(r"\b(1[89]|20)\d\d\b|as under|documentation", source), source
    for year in re.findall(r"\([A-Z][^()]*? (\d{4})\)", text):
        assert year in sources or "as under" in sources, year


def _stands(name: str) -> bool:
    """Whether a dotted name is a module, or what one holds; also as pages shorten it."""
    for root in ("", "skinmap.", "skinmap.live.", "calibration."):
        words, found = f"{root}{name}".split("."), None
        for count in range(len(words), 0, -1):
            try:
                found = importlib.import_module(".".join(words[:count]))
            except ImportError:
                continue
            break
        rest = words[count:] if found is not None else [""]
        while rest and hasattr(found, rest[0]):
            found = getattr(found, rest.pop(0))
        if not rest:
            return True
    return False


def test_modules_that_pages_name_are_there():
    generated = {"json.md", "benchmarks.md"}
    # Values in examples, and names that stand in the code as texts (groups of entry points).
    attributes = {"chart.method", "chart.reason", "info.name", "touch.kind", "touch.motion",
                  "touch.hand", "skin.positions", "touches.pressures"}  # fmt: skip
    code = "".join(path.read_text() for path in (ROOT / "skinmap").rglob("*.py"))
    missing = []
    for page in [*PAGES, ROOT / "SECURITY.md"]:
        text = page.read_text(encoding="utf-8")
        named = set(re.findall(r"`([a-z_]\w*(?:\.[a-z_]\w*)+)(?:\([^`]*)?`", text))
        for name in sorted(named - attributes) if page.name not in generated else ():
            file = re.search(FILE, name)
            if not file and f'"{name}' not in code and not _stands(name):
                missing.append(f"{page.name}: {name}")
    assert not missing


def test_reference_pages_name_modules_that_exist():
    found = re.findall(
        r"generated: modules (\S+) (.*?) -->",
        "\n".join(page.read_text(encoding="utf-8") for page in (DOCS / "reference").glob("*.md")),
    )
    names = [f"{room}.{name}" for room, said in found for name in said.split()]
    assert len(names) > 50
    assert [name for name in names if importlib.util.find_spec(name) is None] == []
