"""Anchors picked in the picture, by real events of mouse and keys, without a screen."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from calibration.commands.anchor_session import AnchorSession
from calibration.commands.calibration_options import Outputs
from calibration.files.tables import BoardTable
from skinmap.cli.main import cli

RADIUS, PITCH = 45e-3, 6.5e-3
CORNERS = (0, 5, 30, 35)


@pytest.fixture(scope="module")
def link():
    mesh = trimesh.creation.cylinder(radius=RADIUS - 0.3e-3, height=0.12, sections=64)
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


@pytest.fixture(scope="module")
def board():
    row, column = np.divmod(np.arange(36), 6)
    layout = PITCH * np.column_stack([column + 0.5 * (row % 2), row * np.sqrt(3) / 2])
    return BoardTable(100 + np.arange(36), row // 3, layout - layout.mean(axis=0))


@pytest.fixture(scope="module")
def places(board):
    angle = board.layout[:, 0] / RADIUS
    out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
    return RADIUS * out + np.column_stack([np.zeros((len(angle), 2)), board.layout[:, 1]])


@pytest.fixture
def session(board, link):
    return AnchorSession(board, link, title="board on link")


@pytest.fixture
def view(opengl, session, tmp_path):
    from viewer.anchors.view import CalibrationView

    made = CalibrationView(session, window_size=(900, 600), output=Outputs(out=tmp_path / "out"))
    made.frame()
    yield made
    made.shut()


def pixel(view, point, *, board=False):
    """The pixel of a point (3,) on the link or the board [m], from the lower left."""
    from viewer.drawing.frame.camera import project

    renderer = view.board.renderer if board else view.link.renderer
    x, y = project(renderer, np.asarray(point)[None])[0] + renderer.GetOrigin()
    return round(x), round(y)


@pytest.fixture
def hand(view):
    """Mouse and keys: events as a window's own interactor gets them."""
    from vtkmodules.vtkRenderingUI import vtkGenericRenderWindowInteractor

    from viewer.anchors.view import Mouse

    interactor = vtkGenericRenderWindowInteractor()
    interactor.SetRenderWindow(view.window)
    interactor.Initialize()
    Mouse(view, interactor)

    class Hand:
        def drag(self, start, end):
            for event, (x, y) in (
                ("LeftButtonPressEvent", start),
                ("MouseMoveEvent", end),
                ("LeftButtonReleaseEvent", end),
            ):
                interactor.SetEventInformation(x, y, 0, 0, "\0", 0, None)
                interactor.InvokeEvent(event)

        def click(self, x, y):
            self.drag((x, y), (x, y))

        def taxel(self, row):
            self.click(*pixel(view, [*view.session.board.layout[row], 0.0], board=True))

        def point(self, place):
            self.click(*pixel(view, place))

        def key(self, name):
            interactor.SetEventInformation(1, 1, 0, 0, name[0], 0, name)
            interactor.InvokeEvent("KeyPressEvent")
            interactor.InvokeEvent("CharEvent")

    yield Hand()
    interactor.SetRenderWindow(None)


def test_clicks_on_board_and_link_become_anchors_and_a_patch(view, hand, places):
    session = view.session
    for row in CORNERS[:3]:
        hand.taxel(row)
        assert session.taxel == row
        hand.point(places[row])
        assert session.taxel is None
    assert [anchor.taxel for anchor in session.anchors] == list(CORNERS[:3])
    # A pixel is 0.3 mm here, and the mesh lies below the taxels, seen at up to 40 degrees.
    points = session.task().points
    assert np.linalg.norm(points - places[list(CORNERS[:3])], axis=1).max() < 1e-3
    assert session.found is not None  # solved by itself as soon as there are three
    missed = np.linalg.norm(session.found.positions - places, axis=1)
    assert np.median(missed) < 1.5e-3
    assert not session.stale
    assert view.status.actor.GetInput().startswith(str(session.found.status))
    assert "predicted error" in view.legend.texts
    assert view.link.lines.mesh.n_cells == 3
    assert view.link.patch.mesh.n_cells == len(places)
    assert view.board.following.mesh.n_cells == 12 * len(session.found.next_taxels)


def test_a_point_may_come_first_and_a_drag_turns_the_link(view, hand, places):
    camera = view.link.renderer.GetActiveCamera()
    before = camera.GetPosition()
    x, y = pixel(view, places[14])
    hand.drag((x, y), (x + 60, y + 20))
    assert camera.GetPosition() != before
    assert view.session.point is None
    hand.point(places[14])
    assert view.session.point is not None
    assert "taxel of that point" in view.message.actor.GetInput()
    hand.taxel(14)
    assert [anchor.taxel for anchor in view.session.anchors] == [14]


def test_clicks_that_miss_say_so_and_change_nothing(view, hand):
    hand.click(5, 300)
    assert "missed the link" in view.message.actor.GetInput()
    hand.click(view.size[0] - 4, 300)
    assert "no taxel there" in view.message.actor.GetInput()
    assert view.session.anchors == ()
    assert view.session.point is None


def test_keys_undo_remove_save_and_close(view, hand, places, tmp_path):
    session = view.session
    for row in CORNERS:
        session.pick_taxel(row)
        session.pick_point(places[row])
    hand.key("u")
    assert session.taxel == CORNERS[3]  # its point went
    hand.key("BackSpace")
    assert session.taxel is None
    assert [anchor.taxel for anchor in session.anchors] == list(CORNERS[:3])
    hand.key("w")
    drawn = view.link.patch.actor.GetProperty()
    assert drawn.GetRepresentationAsString() == "Surface"  # VTK's own w draws a wireframe
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "anchors.csv", "report.html", "taxels.csv",
    ]  # fmt: skip
    hand.taxel(CORNERS[0])
    hand.key("x")
    assert [anchor.taxel for anchor in session.anchors] == list(CORNERS[1:3])
    hand.key("s")
    assert "at least 3 are needed" in view.reasons[0].actor.GetInput()
    hand.key("q")
    assert view.closed


def test_picture_shows_the_patch_and_forgets_it(view, places):
    empty = view.frame()
    for row in CORNERS:
        view.session.pick_taxel(row)
        view.session.pick_point(places[row])
    view.solve_now()
    shown = view.frame()
    assert (shown != empty).any(axis=2).mean() > 0.02
    while view.session.undo():
        pass
    view.solve_now()
    assert view.link.patch.mesh.n_cells == 0
    assert view.legend.texts == ()


def test_collinear_anchors_are_said_in_the_picture(view, hand, places):
    for row in (0, 2, 5):
        view.session.pick_taxel(row)
        view.session.pick_point(places[row])
    hand.key("s")
    assert view.status.actor.GetInput() == "not solved"
    assert "in a row" in view.reasons[0].actor.GetInput()
    assert view.frame().any()


def write(folder, board, link, places, taxels=CORNERS, unit=1.0):
    """Files of a board, a link and anchors; the arguments that name them."""
    rows = [f"{c},{m},{x / unit!r},{y / unit!r}" for c, m, (x, y) in zip(
        board.channels, board.modules, board.layout.tolist(), strict=True)]  # fmt: skip
    (folder / "board.csv").write_text("channel,module,x,y\n" + "\n".join(rows) + "\n")
    trimesh.Trimesh(link[0] / unit, link[1], process=False).export(folder / "link.ply")
    noisy = places[list(taxels)] + np.random.default_rng(0).normal(0, 0.5e-3, (len(taxels), 3))
    lines = [f"{board.channels[t]}," + ",".join(repr(v / unit) for v in p)
             for t, p in zip(taxels, noisy.tolist(), strict=True)]  # fmt: skip
    (folder / "anchors.csv").write_text("channel,x,y,z\n" + "\n".join(lines) + "\n")
    return ["--layout", str(folder / "board.csv"), "--mesh", str(folder / "link.ply")]


@pytest.mark.parametrize(("unit", "name"), [(1.0, "m"), (1e-3, "mm")])
def test_window_writes_what_wrap_writes(opengl, tmp_path, board, link, places, unit, name):
    words = write(tmp_path, board, link, places, unit=unit)
    words += ["--anchors", str(tmp_path / "anchors.csv"), "--units", name]
    picture = tmp_path / "picture.png"
    out = {what: tmp_path / what for what in ("picked", "wrapped", "resumed")}
    shown = CliRunner().invoke(
        cli,
        ["calibrate", "wrap", *words, "-o", str(out["picked"]), "--window", str(picture), "--json"],
    )
    assert shown.exit_code == 0, shown.output
    assert json.loads(shown.stdout)["status"] == "ok"
    assert picture.stat().st_size > 10_000
    wrapped = CliRunner().invoke(cli, ["calibrate", "wrap", *words, "-o", str(out["wrapped"])])
    assert wrapped.exit_code == 0, wrapped.output
    words[words.index("--anchors") + 1] = str(out["picked"] / "anchors.csv")
    resumed = CliRunner().invoke(cli, ["calibrate", "wrap", *words, "-o", str(out["resumed"])])
    assert resumed.exit_code == 0, resumed.output
    for file in ("taxels.csv", "report.html"):
        first = (out["picked"] / file).read_bytes()
        assert first == (out["wrapped"] / file).read_bytes(), file
        assert first == (out["resumed"] / file).read_bytes(), file


def test_window_needs_a_display_or_the_name_of_a_picture(
    opengl, tmp_path, board, link, places, monkeypatch
):
    monkeypatch.setattr("skinmap.display.has_display", lambda: False)
    words = [
        "calibrate",
        "wrap",
        *write(tmp_path, board, link, places),
        "-o",
        str(tmp_path / "out"),
    ]
    result = CliRunner().invoke(cli, [*words, "--window"])
    assert result.exit_code == 2
    assert "no display here" in result.output
    assert "or --window" in CliRunner().invoke(cli, words).output
    old = CliRunner().invoke(cli, ["anchors", "--mesh", "a.stl"])
    assert old.exit_code == 2
    assert "write skinmap calibrate wrap --mesh a.stl --window" in old.output


def test_window_keeps_results_where_there_is_no_answer(opengl, tmp_path, board, link, places):
    words = write(tmp_path, board, link, places, taxels=(0, 5))
    out, picture = tmp_path / "out", tmp_path / "picture.png"
    out.mkdir()
    (out / "taxels.csv").write_text("kept")
    words += ["--anchors", str(tmp_path / "anchors.csv"), "-o", str(out), "--force"]
    result = CliRunner().invoke(cli, ["calibrate", "wrap", *words, "--window", str(picture)])
    assert "2 anchors, at least 3" in str(result.exception)
    assert (out / "taxels.csv").read_text() == "kept"
    assert sorted(path.name for path in out.iterdir()) == ["refused_anchors.csv", "taxels.csv"]
    assert picture.stat().st_size > 10_000
