"""Who asks for one part gets one part: nothing of another is read, meshed, flattened or trained."""

import json
import sys
from collections import defaultdict
from pathlib import Path

import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.flat.flat_map import FlatMap
from skinmap.recognition.classifier import TouchClassifier
from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh

PART, LINK = "left_hand", "l_hand"
opened: list[str] = []
listening = False


def _hear(event: str, arguments: tuple) -> None:
    if listening and event == "open" and isinstance(arguments[0], str):
        opened.append(arguments[0])


sys.addaudithook(_hear)  # hooks stay for good, so it only listens when asked to


@pytest.fixture
def done(monkeypatch):
    """Parts by what was done with them, and the files that were opened."""
    global listening
    did = defaultdict(set)

    def watch(kind: type, method: str, part_of) -> None:
        original = getattr(kind, method)

        def wrapped(self, *args, **kwargs):
            result = original(self, *args, **kwargs)
            did[kind.__name__] |= set(part_of(self, *args))
            return result

        monkeypatch.setattr(kind, method, wrapped)

    watch(Skin, "__post_init__", lambda skin: [skin.part])
    watch(SurfaceMesh, "__post_init__", lambda mesh: [mesh.skin.part])
    watch(FlatMap, "__post_init__", lambda flat: [flat.mesh.skin.part])
    watch(TouchClassifier, "fit", lambda self, touches, **_: [t.skin.skin.part for t in touches])
    opened.clear()
    listening = True
    yield did
    listening = False


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "touches.npz"
    words = ["simulate", "icub", "--part", PART, "--part", "left_forearm", "--per-gesture", "28"]
    CliRunner().invoke(cli, [*words, "-o", str(path)], catch_exceptions=False)
    return path


# `inspect` is not here: it measures a part against its mirror image, so it reads both.
COMMANDS = {
    "flatten": ["flatten", "icub", "--part", PART],
    "structures": ["structures", "icub", "--part", PART],
    "simulate": ["simulate", "icub", "--part", PART, "--per-gesture", "1", "-o", "{out}/t.npz"],
    "export": ["export", "icub", "--part", PART, "--format", "csv", "-o", "{out}/t.csv"],
    "view": ["view", "icub", "--part", PART, "--view-file", "{out}/look.json", "--source", "sim",
             "--screenshot", "{out}/t.png", "--at", "1"],
}  # fmt: skip


@pytest.mark.parametrize("name", COMMANDS)
def test_command_for_one_part_touches_no_other(name, done, recording, tmp_path):
    words = [word.format(out=tmp_path, recording=recording) for word in COMMANDS[name]]
    (tmp_path / "look.json").write_text('{"format": "skinmap-view", "version": 1, "links": "skin"}')
    result = CliRunner().invoke(cli, [*words, "--json"], catch_exceptions=False)
    assert result.exit_code == 0
    json.loads(result.stdout)
    for what, parts in done.items():
        assert parts == {PART}, what
    assert done["Skin"], "nothing was loaded: the check would see nothing"
    taxels = {
        Path(path).stem
        for path in opened
        if "/taxels/" in path and not path.endswith((".py", ".pyc"))
    }
    assert taxels <= {PART}, "another part's taxels were read"
    meshes = {Path(path).name for path in opened if "/meshes/" in path.replace("\\", "/")}
    robot_links = {mesh for mesh in meshes if mesh.endswith((".dae", ".stl", ".obj"))}
    assert len(robot_links) <= 1, f"meshes of other links were read: {sorted(robot_links)}"


def test_training_on_one_part_sees_touches_of_no_other(done, recording, tmp_path):
    words = ["train", str(recording), "--part", PART, "-o", str(tmp_path / "m.skinmodel")]
    CliRunner().invoke(cli, words, catch_exceptions=False)
    assert done["Classifier"] == {PART}
    # The other part of the recording is the second test of the model, so it is loaded, no more.
    assert done["Skin"] == {PART, "left_forearm"}


def test_check_sees_what_is_done_with_two_parts(done, tmp_path):
    words = ["flatten", "icub", "--part", PART, "--part", "left_forearm", "--json"]
    CliRunner().invoke(cli, words, catch_exceptions=False)
    both = {PART, "left_forearm"}
    assert done["Skin"] == done["SurfaceMesh"] == done["FlatMap"] == both
    assert {
        Path(path).stem
        for path in opened
        if "/taxels/" in path and not path.endswith((".py", ".pyc"))
    } == both
