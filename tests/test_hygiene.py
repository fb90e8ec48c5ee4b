"""What holds for the packages as a whole: light imports, names, documents."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.metadata import distribution, version
from pathlib import Path

import pytest

import skinmap

ROOT = Path(__file__).parents[1]
HEAVY = {"numpy", "scipy", "sklearn", "igl", "trimesh", "pyvista", "vtk", "matplotlib", "rich"}


def loaded_by(code: str) -> set[str]:
    """Top-level names of the modules that a fresh interpreter loads for some code."""
    script = f"{code}\nimport sys\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    return set(result.stdout.split("\n")[-2].split())


@pytest.mark.parametrize(
    "code",
    [
        "import skinmap, calibration, viewer",
        "from skinmap.cli.main import cli\n"
        "try:\n    cli(['--help'])\nexcept SystemExit: pass\nprint()",
        "from skinmap.cli.main import cli\n"
        "try:\n    cli(['demo', '--help'])\nexcept SystemExit: pass\nprint()",
        "from skinmap.cli.main import cli\n"
        "try:\n    cli(['flatten', '--help'])\nexcept SystemExit: pass\nprint()",
    ],
)
def test_imports_and_help_load_nothing_heavy(code):
    assert not loaded_by(code) & HEAVY


def test_loading_a_robot_needs_no_window():
    loaded = loaded_by("import skinmap; skinmap.load_robot('icub').skin('left_hand'); print()")
    assert not loaded & {"pyvista", "vtk", "matplotlib", "torch"}
    assert "numpy" in loaded


def test_installed_names_are_ours():
    # The names are generic: PyPI's `uncertainty-calibration` also installs a `calibration`.
    tops = distribution("skinmap").read_text("top_level.txt").split()
    assert sorted(tops) == ["calibration", "skinmap", "viewer"]
    for name in tops:
        module = __import__(name)
        assert Path(module.__file__).resolve().parents[1] == ROOT, f"{name} is another's package"


def test_public_names_exist():
    for name in skinmap.__all__:
        assert getattr(skinmap, name) is not None
    assert set(skinmap.__all__) <= set(dir(skinmap))
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = skinmap.nothing


def test_version_is_the_distributions():
    assert skinmap.__version__ == version("skinmap")


def test_commands_of_the_readme_exist():
    from click.testing import CliRunner

    from skinmap.cli.main import cli

    text = "".join((ROOT / name).read_text() for name in ("README.md", "docs/quickstart.md"))
    commands = set(re.findall(r"^\s*(?:\.venv/bin/)?skinmap (\w+)", text, flags=re.MULTILINE))
    assert {"demo", "inspect", "flatten", "structures", "simulate", "train", "classify"} <= commands
    for command in commands:
        result = CliRunner().invoke(cli, [command, "--help"])
        assert result.exit_code == 0, command
        assert "Example:" in result.output, command
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"^\s*make (\w+)", text, flags=re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target


def test_readmes_python_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # it saves a model
    text = (ROOT / "README.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    exec(compile(code, "README.md", "exec"), {})


def test_misspelt_command_is_answered_with_those_that_exist():
    from click.testing import CliRunner

    from skinmap.cli.main import cli

    result = CliRunner().invoke(cli, ["inspct", "icub"])
    assert result.exit_code == 2
    assert (
        "no command 'inspct'; did you mean 'inspect'? The commands are: demo, new, inspect,"
        in result.output
    )


def test_every_file_of_the_packages_is_in_the_wheel():
    """Whatever stands beside the code and is not Python must be named in `package-data`."""
    named = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    patterns = [
        f"{package.replace('.', '/')}/{pattern}"
        for package, own in named["package-data"].items()
        for pattern in own
    ]
    packed = {path for pattern in patterns for path in ROOT.glob(pattern)}
    others = {
        path
        for top in ("skinmap", "calibration", "viewer")
        for path in (ROOT / top).rglob("*")
        if path.is_file() and path.suffix not in (".py", ".pyc", ".nbi", ".nbc")
    }
    assert others
    assert not others - packed
