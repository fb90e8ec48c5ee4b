import os
import subprocess
import sys

import pytest

from skinmap.display import WINDOW_CLASS, has_display, require_opengl, window_class
from skinmap.errors import MissingLibraryError, OutputError

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux only")


@pytest.fixture(autouse=True)
def keep_window_class(monkeypatch):
    monkeypatch.setenv(WINDOW_CLASS, os.environ.get(WINDOW_CLASS, ""))


@linux
@pytest.mark.parametrize("window", [True, False])
def test_require_opengl_without_any_library_says_what_to_install_in_one_line(window):
    with pytest.raises(MissingLibraryError, match="libgl1 libegl1") as caught:
        require_opengl(window=window, loads=lambda name: False)
    assert "\n" not in str(caught.value)


@linux
def test_require_opengl_refuses_a_window_without_a_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(OutputError, match="no display"):
        require_opengl(window=True, loads=lambda name: True)


@pytest.mark.parametrize(
    ("libraries", "hidden", "expected"),
    [
        ({"libGL.so.1", "libEGL.so.1"}, True, "vtkEGLRenderWindow"),
        ({"libGL.so.1", "libEGL.so.1"}, False, None),
        ({"libGL.so.1", "libOSMesa.so.8"}, True, "vtkOSOpenGLRenderWindow"),
        ({"libOSMesa.so"}, True, "vtkOSOpenGLRenderWindow"),
    ],
)
def test_window_class_follows_the_libraries_that_load(libraries, hidden, expected):
    assert window_class(hidden, libraries.__contains__) == expected


@linux
def test_require_opengl_sets_what_vtk_reads(monkeypatch):
    monkeypatch.setattr("skinmap.display.has_display", lambda: False)
    require_opengl(loads=lambda name: True)
    assert os.environ[WINDOW_CLASS] == "vtkEGLRenderWindow"
    monkeypatch.setattr("skinmap.display.has_display", lambda: True)
    require_opengl(window=True, loads=lambda name: True)
    assert WINDOW_CLASS not in os.environ


@linux
@pytest.mark.parametrize("display", ["", ":987"])
def test_has_display_is_false_without_a_server_that_answers(monkeypatch, display):
    monkeypatch.setenv("DISPLAY", display)
    assert not has_display()


def test_display_is_asked_without_importing_vtk():
    code = (
        "import sys, skinmap.display; print(any('vtk' in m or m == 'numpy' for m in sys.modules))"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert answer.stdout.strip() == "False", answer.stderr


BOARD = ["--layout", "board.csv", "--mesh", "link.stl", "-o", "out", "--window"]
WINDOWS = (["view", "icub"], ["calibrate", "wrap", *BOARD])
COMMANDS = (  # a demo needs no display
    *((words, missing) for words in WINDOWS for missing in ("library", "display")),
    (["demo"], "library"),
)


@linux
@pytest.mark.parametrize(("words", "missing"), COMMANDS)
def test_commands_without_opengl_or_a_display_end_with_one_line(words, missing, tmp_path):
    """In a process of its own, where the libraries cannot be found or no display is named."""
    code = "import ctypes, sys\n"
    if missing == "library":
        code += "def none(name, *_, **__): raise OSError(name)\nctypes.CDLL = none\n"
        if words[0] == "view":  # no window: then it would ask for a display first
            words = [*words, "--screenshot", "robot.png"]
    code += "from skinmap.cli.main import main\nsys.argv[0] = 'skinmap'\nmain()"
    clean = {
        key: value for key, value in os.environ.items() if key not in ("DISPLAY", WINDOW_CLASS)
    }
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        capture_output=True,
        text=True,
        env=clean,
        cwd=tmp_path,
    )
    assert done.returncode == 2, done.stderr
    line = done.stderr.strip().splitlines()[-1]
    assert ("libgl1" if missing == "library" else "display") in line
    assert "Traceback" not in done.stderr
