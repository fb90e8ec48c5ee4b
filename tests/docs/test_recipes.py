"""Each recipe of docs/howto/recipes.md runs by itself, with public names, and prints something."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "howto" / "recipes.md").read_text(encoding="utf-8")
RECIPES = dict(re.findall(r"^## \d+\. (.*?)$.*?^```python\n(.*?)^```", PAGE, re.M | re.S))
PACKAGES = ("skinmap", "calibration")


def test_there_are_ten_and_readme_names_them():
    assert len(RECIPES) >= 10
    assert "docs/howto/recipes.md" in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("recipe", RECIPES)
def test_recipe_uses_public_names(recipe):
    for node in ast.walk(ast.parse(RECIPES[recipe])):
        if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] in PACKAGES:
            public = importlib.import_module(node.module).__all__
            assert {alias.name for alias in node.names} <= set(public)
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "skinmap":
            assert node.attr in dir(importlib.import_module("skinmap"))


@pytest.mark.parametrize("recipe", RECIPES)
def test_recipe_runs_by_itself(recipe, tmp_path):
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    run = [sys.executable, "-W", "error", "-c", RECIPES[recipe]]
    done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    written = [path for path in tmp_path.iterdir() if path.name != "docs"]
    assert done.stdout or written
    assert all(path.stat().st_size for path in written)


def test_the_python_of_the_quickstart_runs(tmp_path):
    page = (ROOT / "docs" / "quickstart.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```", page, re.M | re.S)
    done = subprocess.run(
        [sys.executable, "-c", block], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) > 0
