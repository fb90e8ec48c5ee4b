"""The public interface: every name is typed, documented, and its example runs."""

from __future__ import annotations

import ast
import doctest
import importlib.util
import inspect
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import skinmap

ROOT = Path(__file__).parents[1]
STUB = ast.parse((ROOT / "skinmap" / "__init__.pyi").read_text())
PLACES = {
    alias.asname or alias.name: node.module
    for node in STUB.body
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
}
NAMES = sorted(set(skinmap.__all__) - {"__version__", "errors"})
DRAWS = {"Scene", "show"}  # what needs OpenGL
EXTRA = {"register_scan": "open3d"}
# Objects with a line at the prompt: made once, by the chain that most users go.
SHOWN = (
    "Robot", "Skin", "SurfaceMesh", "FlatMap", "Structures", "Codebook", "Recording", "Classifier",
    "TouchLoop", "Moment",
)  # fmt: skip


def test_the_stub_is_the_list_of_names():
    assert set(dir(skinmap)) == {*PLACES, *skinmap.__all__}
    assert {*skinmap.__all__} <= {*PLACES, "__version__"}


@pytest.mark.parametrize(
    "stub", sorted(ROOT.glob("[a-z]*/**/__init__.pyi")), ids=lambda path: path.parent.name
)
def test_no_name_is_that_of_a_module_beside_it(stub):
    # An import of the module would set it under the name, and nobody would find the object.
    places = {
        alias.asname or alias.name: node.module or ""
        for node in ast.parse(stub.read_text()).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    beside = {path.stem for path in stub.parent.iterdir()}
    package = ".".join(stub.parent.relative_to(ROOT).parts)
    assert not [name for name, module in places.items() if name in beside and module != package]


def test_there_are_about_thirty_names():
    assert 28 <= len(skinmap.__all__) <= 40
    assert set(skinmap.__all__) <= set(dir(skinmap))
    with pytest.raises(AttributeError, match="no attribute 'flaten'"):
        skinmap.flaten  # noqa: B018


@pytest.mark.parametrize("name", sorted(set(PLACES) - {"errors"}))
def test_a_name_is_found_and_says_what_it_is(name):
    assert len(inspect.getdoc(getattr(skinmap, name)).splitlines()[0]) > 15


def signature(thing) -> inspect.Signature:
    return inspect.signature(thing)


@pytest.mark.parametrize("name", NAMES)
def test_a_name_has_its_sections(name):
    thing = getattr(skinmap, name)
    text = inspect.getdoc(thing)
    if inspect.isclass(thing) and issubclass(thing, Exception):
        return
    assert re.search(r"^Examples\n-{8}\n", text, flags=re.MULTILINE)
    if inspect.isclass(thing):
        assert re.search(r"^(Parameters|Attributes)\n-+\n", text, flags=re.MULTILINE)
        return
    takes = bool(signature(thing).parameters)  # a list of names takes nothing and cannot fail
    for section in ("Parameters", "Returns", "Raises") if takes else ("Returns",):
        if section == "Returns" and signature(thing).return_annotation == "None":
            continue
        assert re.search(rf"^{section}\n-+\n", text, flags=re.MULTILINE), section
    described = text.partition("Parameters\n")[2].partition("\nReturns\n")[0]
    for parameter in signature(thing).parameters:
        assert re.search(rf"^(\w+, )*{parameter}(, \w+)* : ", described, flags=re.MULTILINE), (
            f"{name} says nothing of {parameter}"
        )


@pytest.mark.parametrize("name", NAMES)
def test_its_example_runs(name, tmp_path, monkeypatch):
    if name in DRAWS:
        from skinmap.display import require_opengl

        require_opengl()
    if name in EXTRA and importlib.util.find_spec(EXTRA[name]) is None:
        pytest.skip(f"{EXTRA[name]} is not installed")
    monkeypatch.chdir(tmp_path)
    thing = getattr(skinmap, name)
    (example,) = doctest.DocTestFinder(recurse=False).find(thing, name, module=False, globs={})
    if not example.examples:
        assert inspect.isclass(thing)
        assert issubclass(thing, Exception)
        return
    said: list[str] = []
    doctest.DocTestRunner().run(example, out=said.append)
    assert not said, "".join(said)


@pytest.fixture(scope="module")
def chain():
    """One object of each class, from a small robot."""
    robot = skinmap.load_robot("kaspar")
    skin = robot.skin("torso")
    mesh = skinmap.build_surface(skin)
    flat = skinmap.flatten(mesh)
    structures = skinmap.find_structures(flat)
    gestures = ["poke", "full_finger"]
    recording = skinmap.simulate(skin, per_gesture=8, gestures=gestures, rng=0)
    source = skinmap.open_source("sim", robot=robot, parts=["torso"], speed=float("inf"))
    classifier = skinmap.train(recording, robot)
    loop = skinmap.TouchLoop(robot, source, classifier=classifier)
    made = {
        "Robot": robot, "Skin": skin, "SurfaceMesh": mesh, "FlatMap": flat,
        "Structures": structures, "Recording": recording, "Classifier": classifier,
        "Codebook": skinmap.learn_codebook([(structures, recording.pressures)], rng=0),
        "TouchLoop": loop, "Moment": next(iter(loop)),
    }  # fmt: skip
    yield made
    loop.close()


@pytest.mark.parametrize("name", SHOWN)
def test_an_object_is_one_short_line_without_arrays(name, chain):
    one = chain[name]
    assert isinstance(one, getattr(skinmap, name))
    line = repr(one)
    assert line.startswith(f"{name}(")
    assert "\n" not in line
    assert "array" not in line
    assert len(line) < 200
    page = one._repr_html_()
    for fact, value in one.facts().items():
        assert fact.replace("_", " ") in page
        assert str(value) in line
    assert page.startswith("<table>")


def test_what_a_notebook_shows_is_no_markup_of_a_file(chain):
    from dataclasses import replace

    skin = replace(chain["Skin"], part="<script>alert(1)</script>")
    assert "<script>" not in skin._repr_html_()


def test_classify_is_a_function_whatever_was_imported(chain):
    import skinmap.recognition.naming

    for name in skinmap.recognition.__all__:
        assert callable(getattr(skinmap.recognition, name)) or name == "classifiers"
    assert inspect.isfunction(skinmap.classify)
    named = skinmap.classify(chain["Recording"], chain["Classifier"], chain["Robot"])
    assert len(named) >= len(chain["Recording"].labels)
    assert inspect.signature(skinmap.classify).parameters.keys() >= {"recordings", "classifier"}
    with pytest.raises(TypeError):
        skinmap.classify(chain["Recording"])


def test_train_refuses_what_it_cannot_use(chain):
    robot, touches = chain["Robot"], chain["Recording"]
    with pytest.raises(skinmap.UnknownNameError, match="recorded part 'left_arm'"):
        skinmap.train(touches, robot, parts=["left_arm"])
    with pytest.raises(skinmap.UnknownNameError, match="'svm'"):
        skinmap.train(touches, robot, classifier="svm")
    with pytest.raises(skinmap.SkinMismatchError, match="240 taxels"):
        skinmap.train(touches, skinmap.load_robot("icub"))
    same = skinmap.train(touches, robot, rng=np.random.default_rng(0))
    assert same.labels == chain["Classifier"].labels


def test_record_keeps_a_file_unless_told(tmp_path, chain):
    path = tmp_path / "touch.mcap"
    made = skinmap.record("sim", path, seconds=0.1)
    assert made.files == (path,)
    assert made.dropped == 0
    with pytest.raises(skinmap.OutputError, match="exists already"):
        skinmap.record("sim", path, seconds=0.1)
    assert skinmap.record("sim", path, seconds=0.1, replace=True).samples == made.samples
    with pytest.raises(skinmap.UnknownNameError, match="mcap"):
        skinmap.record("sim", tmp_path / "touch.txt")


def test_a_contact_image_is_masked_where_there_is_no_skin(chain):
    flat = chain["FlatMap"]
    image = skinmap.contact_image(flat, np.ones(len(flat.uv)))
    assert image.mask.any()
    np.testing.assert_allclose(image.compressed(), 1.0, rtol=1e-6)  # weights of float32
    several = skinmap.contact_image(flat, np.ones((3, len(flat.uv))))
    assert several.shape == (3, *image.shape)
    with pytest.raises(skinmap.SkinMismatchError):
        skinmap.contact_image(flat, np.ones(7))


def test_import_loads_nothing_heavy():
    code = (
        "import sys, skinmap; "
        "print(sorted({'numpy', 'scipy', 'sklearn', 'calibration', 'viewer', 'pyvista'}"
        " & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_live_tutorial_needs_fifteen_lines_and_one_import():
    script = (ROOT / "docs" / "tutorials" / "see_touches_live.py").read_text()
    lines = [
        line for line in script.splitlines() if line.strip() and not line.startswith(("#", '"'))
    ]
    assert len(lines) <= 15
    assert [line for line in lines if "import" in line] == ["import skinmap"]
