"""Shapes and skins that many tests share."""

from __future__ import annotations

import importlib.util
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

import skinmap
from skinmap.touch.prepared_skin import PreparedSkin

# The same examples each time: a gate must not depend on luck. Hypothesis still replays what it
# once found failing; `HYPOTHESIS_PROFILE=search` looks for new examples. How long an example takes
# is no test: on a busy machine a sound one takes longer than Hypothesis allows by default.
settings.register_profile("suite", derandomize=True, deadline=None)
settings.register_profile("search", derandomize=False, deadline=None)
settings.register_profile(
    "fuzz",
    settings.get_profile("search"),
    max_examples=int(os.environ.get("FUZZ_EXAMPLES", "5000")),
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "suite"))

# What a test makes it makes itself, and nobody's own cache is touched.
os.environ["SKINMAP_CACHE"] = "off"

# Taxel places in one module, in mm, origin at its centre.
PAD_12 = [
    (7.5, -1.443), (10, -5.774), (5, -5.774), (0, -2.887), (-5, -5.774), (-10, -5.774),
    (-7.5, -1.443), (-2.5, 1.443), (-2.5, 7.217), (0, 11.547), (2.5, 7.217), (2.5, 1.443),
]  # fmt: skip


# Files of many seconds begin, and files of few end: no process is left with a long one alone.
LONGEST = (
    "test_load.py", "test_plane.py", "test_same_picture.py", "test_self_touches.py",
    "test_readme_commands.py", "test_checkup.py", "test_demo.py", "test_your_touches.py",
    "test_recipes.py", "test_calibration_lines.py", "test_bench_classify.py", "test_scan.py",
    "test_load_by_prints.py", "test_history.py", "test_notebook.py",
)  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that take long first, then what is drawn, then the others, each in their order."""

    def turn(item: pytest.Item) -> int:
        name = item.path.name
        return LONGEST.index(name) if name in LONGEST else 99 + ("viewer" not in item.path.parts)

    items.sort(key=turn)


@pytest.fixture(scope="session", autouse=True)
def _own_notes(tmp_path_factory):
    """Which command made which file is noted for this run alone."""
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("state"))


@pytest.fixture(autouse=True)
def _ctrl_c_is_heard():
    """Each test begins with Ctrl-C heard, and so do the commands that it starts and interrupts.

    A shell without job control starts what runs in the background (`make test &` in a script) with
    Ctrl-C ignored, a test or a library may leave it so, and every child inherits that.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def _json_keeps_its_schema(monkeypatch):
    """What a test has a command print as JSON is held to docs/schemas."""
    path = Path(__file__).with_name("schemas.py")
    spec = importlib.util.spec_from_file_location("skinmap_test_schemas", path)
    schemas = sys.modules.get("skinmap_test_schemas")
    if schemas is None:
        schemas = sys.modules["skinmap_test_schemas"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(schemas)
    schemas.watch(monkeypatch)


@pytest.fixture
def hurried(monkeypatch) -> None:
    """Simulators play as fast as they are followed, for tests that are not about their clock."""
    hurry(monkeypatch)


@pytest.fixture(scope="module")
def hurried_module() -> Iterator[None]:
    """The same for fixtures of a module."""
    with pytest.MonkeyPatch.context() as patch:
        hurry(patch)
        yield


def hurry(patch: pytest.MonkeyPatch) -> None:
    from skinmap.live.sources.simulated_source import MadeSource

    plain = MadeSource.__init__

    def at_once(self: MadeSource, *given: Any, **how: Any) -> None:
        plain(self, *given, **how | {"speed": float("inf")})

    patch.setattr(MadeSource, "__init__", at_once)


@pytest.fixture(scope="session")
def whole() -> bool:
    """Whether tests marked `soak` run whole, as in `make soak`, or in the suite's short form."""
    return os.environ.get("SUITE") == "whole"


@pytest.fixture(scope="session")
def icub():
    """The robot that ships with Skinmap."""
    return skinmap.load_robot("icub")


@pytest.fixture(scope="session")
def prepared(icub) -> Callable[[str], PreparedSkin]:
    """Prepared skins of the iCub by part, each made once for the whole run."""
    made: dict[str, PreparedSkin] = {}

    def get(part: str) -> PreparedSkin:
        if part not in made:
            made[part] = PreparedSkin(icub.skin(part))
        return made[part]

    return get


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)


@pytest.fixture(scope="session")
def tiling_12() -> np.ndarray:
    """A flat tiling of 72 12-pad modules of side 30 mm, (864, 3) in metres."""
    pad, side = np.array(PAD_12), 30.0
    height = side * np.sqrt(3) / 2
    modules = []
    for i in range(6):
        for j in range(6):
            corner = np.array([side * (i + 0.5 * j), height * j])
            modules.append(pad + corner)
            modules.append(-pad + corner + [side / 2, height / 3])
    flat = np.concatenate(modules) * 1e-3
    return np.column_stack([flat, np.zeros(len(flat))])


@pytest.fixture(scope="session")
def hexagons() -> np.ndarray:
    """A hexagonal lattice of 12 x 14 points with a pitch of 6.5 mm, (168, 2) in metres."""
    row, column = np.divmod(np.arange(168), 12)
    return 6.5e-3 * np.column_stack([column + 0.5 * (row % 2), row * np.sqrt(3) / 2])


@pytest.fixture(scope="session")
def square_grid():
    """A function: (vertices, faces) of an n x n unit grid, two triangles a cell."""

    def make(n: int) -> tuple[np.ndarray, np.ndarray]:
        row, column = np.divmod(np.arange(n * n), n)
        vertices = np.column_stack([column, row, np.zeros(n * n)]) / (n - 1)
        corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
        lower = np.column_stack([corner, corner + 1, corner + n])
        upper = np.column_stack([corner + 1, corner + n + 1, corner + n])
        return vertices, np.concatenate([lower, upper])

    return make


@pytest.fixture(scope="session")
def half_cylinder(square_grid):
    """The 15 x 15 grid bent round a cylinder of radius 1/3: isometric but for its facets."""
    vertices, faces = square_grid(15)
    angle = 3.0 * vertices[:, 0]
    bent = np.column_stack([np.sin(angle) / 3.0, vertices[:, 1], (1 - np.cos(angle)) / 3.0])
    return bent, faces


@pytest.fixture(scope="session")
def sphere():
    """An icosphere: closed, 162 vertices."""
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=2)
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


@pytest.fixture(scope="session")
def same_table():
    """A function: whether two tables hold the same bits."""

    def check(one, other) -> None:
        for name in ("channels", "modules", "positions", "normals"):
            a, b = getattr(one, name), getattr(other, name)
            assert a.dtype == b.dtype
            # Bytes, not values: 0.0 equals -0.0 and yet differs.
            assert np.ascontiguousarray(a).tobytes() == np.ascontiguousarray(b).tobytes(), name

    return check
