"""`skinmap view`: pictures and files without a screen, and one clear line for bad input."""

from __future__ import annotations

import json
import math
import re
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import (
    DataFormatError,
    InvalidArrayError,
    MissingFileError,
    OutputError,
    SkinError,
    SkinMismatchError,
    UnknownNameError,
    UnreachableError,
)
from skinmap.geometry.rigid import transform_points
from skinmap.live.sources.source import Block, Source, StreamInfo
from viewer.inputs import parse_address, read_token
from viewer.view_files import movie_frames

FOOT = ("--part", "left_foot")
HEAD = {"format": "skinmap-view", "version": 1}


def view(*words: str, settings: dict | None = None, **options) -> dict:
    """What the command gives; without other settings the links with skin are drawn: it is quick."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "view.json"
        path.write_text(json.dumps({**HEAD, "links": "skin", **(settings or {})}))
        how = [] if "--view-file" in words else ["--view-file", str(path)]
        result = CliRunner().invoke(cli, ["view", "icub", *words, *how, "--json"], **options)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Some simulated touches on the left sole."""
    path = tmp_path_factory.mktemp("view") / "touches.npz"
    words = ["simulate", "icub", "--part", "left_foot", "--per-gesture", "1", "-o", str(path)]
    assert CliRunner().invoke(cli, words).exit_code == 0
    return path


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A model that takes no time to train."""
    folder = tmp_path_factory.mktemp("model")
    touches, path = folder / "t.npz", folder / "m.skinmodel"
    words = ["simulate", "icub", "--part", "left_foot", "--per-gesture", "10", "-o", str(touches)]
    assert CliRunner().invoke(cli, words).exit_code == 0
    assert CliRunner().invoke(cli, ["train", str(touches), "-o", str(path)]).exit_code == 0
    return path


def test_help_needs_nothing_heavy_and_lists_the_layers():
    from viewer.layers import LAYERS

    code = (
        "import sys; from skinmap.cli.main import main; sys.argv = ['skinmap', 'view', '--help']\n"
        "try: main()\nexcept SystemExit: pass\n"
        "heavy = {'numpy', 'pyvista', 'vtkmodules', 'scipy', 'sklearn', 'trimesh'}\n"
        "sys.exit(bool(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    text = " ".join(done.stdout.split())
    assert ", ".join(LAYERS) in text
    assert "Example:" in text


def test_picture_of_the_simulator_names_its_touches(opengl, tmp_path, model):
    path = tmp_path / "out.png"
    shown = view(*FOOT, "--source", "sim", "--model", str(model), "--screenshot", str(path))
    assert shown["files"] == [str(path)]
    assert shown["touches"]
    assert {touch["part"] for touch in shown["touches"]} == {"left_foot"}
    assert all(0 <= touch["confidence"] <= 1 for touch in shown["touches"])
    assert path.read_bytes().startswith(b"\x89PNG")


def test_recording_gives_picture_movie_page_and_gltf(opengl, tmp_path, recording, model):
    import imageio_ffmpeg

    names = {suffix: tmp_path / f"out.{suffix}" for suffix in ("png", "mp4", "html", "glb")}
    shown = view(
        *FOOT, "--source", str(recording), "--model", str(model), "--seconds", "2",
        "--layer", "binary", "--screenshot", str(names["png"]), "--movie", str(names["mp4"]),
        "--html", str(names["html"]), settings={"style": "discs"},
    )  # fmt: skip
    solid = view(*FOOT, "--source", str(recording), "--screenshot", str(names["glb"]))
    shown["files"] += solid["files"]
    assert sorted(shown["files"]) == sorted(str(path) for path in names.values())
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(names["mp4"]))
    # 2 s at 25 frames a second, both ends shown.
    assert 50 <= frames <= 52
    assert seconds == pytest.approx(frames / 25, abs=0.1)
    assert all(path.stat().st_size > 5000 for path in names.values())


@pytest.mark.parametrize(("rate", "speed"), [(50.0, 1.0), (50.0, 2.0), (10.0, 1.0), (10.0, 0.5)])
def test_a_movie_lasts_as_long_as_its_recording(rate, speed):
    """`--speed` changed nothing, and a recording of 10 Hz played two and a half times too fast."""

    class Shown:
        time = None

        def follow(self, moment):
            self.time = moment.time

        def frame(self, calm):
            return self.time

    times = np.arange(0.0, 4.0, 1.0 / rate)
    times = 1.7e9 + times[(times < 1.0) | (times > 2.0)]  # a second of silence
    frames = list(movie_frames(Shown(), [SimpleNamespace(time=one) for one in times], speed))
    assert len(frames) == pytest.approx(4.0 * 25.0 / speed, abs=4)
    own = 1.7e9 + np.arange(len(frames)) * speed / 25.0
    silent = (own > 1.7e9 + 0.9) & (own < 1.7e9 + 2.1)
    assert np.abs(own - frames)[~silent].max() < 1.0 / rate + 0.04
    assert np.array(frames)[silent].max() < 1.7e9 + 2.2, "it stands where nothing came"


def test_a_bag_alone_is_a_recording(opengl, tmp_path, recording):
    bag = tmp_path / "bag"
    words = ["export", str(recording), "--format", "rosbag2", "-o", str(bag)]
    assert CliRunner().invoke(cli, words).exit_code == 0
    shown = CliRunner().invoke(cli, ["view", str(bag), "--screenshot", str(tmp_path / "a.png")])
    assert shown.exit_code == 0, shown.output


def test_picture_at_a_time_shows_that_time(opengl, tmp_path, recording, model):
    path = tmp_path / "out.png"
    words = (*FOOT, "--source", str(recording), "--model", str(model), "--screenshot", str(path))
    shown = view(*words, "--at", "1.5")
    with np.load(recording) as arrays:
        step = 0.02
        assert len(arrays.files) > 0
    assert shown["time"] == pytest.approx(1.5, abs=step)


def test_pose_and_saved_view_are_taken(opengl, tmp_path, recording, model):
    from viewer.interaction.view_file import SavedView, save_view

    saved = save_view(
        SavedView("iCub", (1.0, 0.0, 0.0), (0.0, 0.0, -0.5), (0.0, 0.0, 1.0), 20.0,
                  layer="patches", style="discs", part="left_foot"),
        tmp_path / "view.json",
    )  # fmt: skip
    words = (*FOOT, "--source", str(recording), "--model", str(model), "--at", "1")
    one, other = tmp_path / "a.png", tmp_path / "b.png"
    view(*words, "--screenshot", str(one), "--view-file", str(saved))
    saved.write_text(json.dumps(json.loads(saved.read_text()) | {"pose": {"l_ankle_pitch": 20}}))
    view(*words, "--screenshot", str(other), "--view-file", str(saved))
    assert one.read_bytes() != other.read_bytes()


@pytest.mark.parametrize(
    ("words", "kind", "match"),
    [
        (
            ["--layer", "heat"],
            UnknownNameError,
            "no layer 'heat'; did you mean 'health'. The layers are: pressure, raw",
        ),
        (["--part", "wing"], UnknownNameError, "no part 'wing'"),
        (["--source", "radio"], UnknownNameError, "no source 'radio'"),
        (["--source", "none.npz"], MissingFileError, "no file 'none.npz'"),
        (["--model", "none.skinmodel"], MissingFileError, "none.skinmodel"),
        (["--calibration", "left_foot=none.csv"], SkinError, "none.csv"),
        (["--response", "wing=x.npz"], UnknownNameError, "no part to calibrate 'wing'"),
        (["--response", "x.npz"], MissingFileError, "a response calibration"),
    ],
)
def test_bad_input_is_one_clear_line(opengl, tmp_path, words, kind, match):
    part = [] if "--part" in words else list(FOOT)
    with pytest.raises(kind, match=match) as error:
        view(*part, *words, "--screenshot", str(tmp_path / "a.png"))
    assert "\n" not in str(error.value)
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize(
    ("settings", "kind", "match"),
    [
        ({"style": "balls"}, DataFormatError, "'balls'"),
        ({"stile": "discs"}, UnknownNameError, "did you mean 'style'"),
        ({"links": "arms"}, DataFormatError, "'arms'"),
        ({"layer": "heat"}, UnknownNameError, "did you mean 'health'"),
        (
            {"pose": {"l_elbow": 500}},
            InvalidArrayError,
            "'l_elbow' cannot be at 500.0 degrees: its limits are",
        ),
        ({"pose": {"l_elbow": math.nan}}, InvalidArrayError, "cannot be at nan degrees"),
        ({"pose": {"l_elbow": "bent"}}, DataFormatError, "Expected `float`"),
        ({"pose": {"wing": 3}}, UnknownNameError, "no joint 'wing'"),
        ({"size": "big"}, DataFormatError, "size"),
        ({"size": [20, 20]}, DataFormatError, ">= 160"),
        ({"ranges": {"pressure": 9}}, DataFormatError, "ranges"),
        ({"ranges": {"pressure": [9, 3]}}, InvalidArrayError, "must be below the second"),
        ({"ranges": {"smell": [1, 2]}}, UnknownNameError, "no layer 'smell'"),
        ({"units": ["%"]}, UnknownNameError, "no setting in"),
    ],
)
def test_wrong_settings_of_a_view_file_are_one_clear_line(opengl, tmp_path, settings, kind, match):
    with pytest.raises(kind, match=match) as error:
        view(*FOOT, "--screenshot", str(tmp_path / "a.png"), settings=settings)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize(
    "words",
    [("--style", "discs"), ("--links", "skin"), ("--pose", "l_elbow=9"), ("--size", "300x400"),
     ("--range", "auto"), ("--unit", "%"), ("--follow",), ("--detail", "2"), ("--loop",),
     ("--contour-rate", "5"), ("--host", "::1"), ("--port", "80"), ("--token", "x" * 20)],
)  # fmt: skip
def test_options_of_before_answer_with_what_to_write_instead(words):
    result = CliRunner().invoke(cli, ["view", "icub", *words])
    assert result.exit_code == 2
    assert f"{words[0]} was removed: " in result.output


def test_saving_a_view_keeps_the_settings_of_its_file(tmp_path):
    from viewer.interaction.view_file import SavedView, load_settings, load_view, save_view

    path = tmp_path / "view.json"
    path.write_text(json.dumps(HEAD | {"links": "none", "size": [200, 300], "layer": "raw"}))
    saved = SavedView("iCub", (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 20.0)
    save_view(saved, path)
    assert load_view(path) == saved
    found = load_settings(path)
    assert (found.links, found.size, found.layer) == ("none", (200, 300), "pressure")


def test_folders_that_are_not_there_are_told_before_any_work(tmp_path):
    with pytest.raises(OutputError, match="no folder"):
        view("--screenshot", str(tmp_path / "no" / "a.png"))


@pytest.mark.parametrize(
    ("words", "match"),
    [
        (["--movie", "a.avi"], "no format for files ending in '.avi'; the formats are: .mp4, .gif"),
        (["--web", "--screenshot", "a.png"], "one of them"),
    ],
)
def test_options_that_do_not_go_together_are_told(words, match):
    result = CliRunner().invoke(cli, ["view", *words])
    assert (result.exit_code, match in result.output) == (2, True)


def test_missing_display_is_one_line(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    result = CliRunner().invoke(cli, ["view"])
    assert result.exit_code == 2
    assert "no display was found: give --screenshot, --movie, --html or --web" in result.output


@pytest.mark.parametrize("text", ["{}", "no json", '{"format": "skinmap-view", "version": 9}'])
def test_damaged_view_file_is_told(opengl, tmp_path, text):
    path = tmp_path / "view.json"
    path.write_text(text)
    with pytest.raises(DataFormatError, match="view"):
        view(*FOOT, "--view-file", str(path), "--screenshot", str(tmp_path / "a.png"))


@pytest.mark.parametrize("words", [("--screenshot", "a.png"), ("--html", "a.html")])
def test_a_mistyped_view_file_is_refused_for_a_file(tmp_path, words):
    with pytest.raises(MissingFileError, match="no file"):
        view(*FOOT, "--view-file", "veiw.json", words[0], str(tmp_path / words[1]))


def test_recording_of_another_skin_is_refused(opengl, tmp_path, recording):
    with pytest.raises(SkinError, match="left_foot"):
        view("--part", "torso", "--source", str(recording), "--screenshot", str(tmp_path / "a.png"))
    with np.load(recording) as arrays:
        broken = dict(arrays)
    for name, values in broken.items():
        if values.ndim == 2:
            broken[name] = values[:, :-1]
    path = tmp_path / "short.npz"
    np.savez(path, **broken)
    with pytest.raises(SkinError):
        view(*FOOT, "--source", str(path), "--screenshot", str(tmp_path / "a.png"))


def test_port_in_use_is_told(opengl):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        with pytest.raises(UnreachableError, match=f"port {port} of 127.0.0.1 is in use"):
            view(*FOOT, "--web", port, "--seconds", "1")


class Dying(Source):
    """A live source that sends some samples and then does what a test wants."""

    def __init__(self, robot, then) -> None:
        self.n, self.then, self.sent = len(robot.skin("left_foot")), then, 0
        super().__init__(StreamInfo("dying", ("left_foot",), (self.n,), 50.0, clock="local"))

    def read(self, timeout):
        self.sent += 1
        if self.sent > 5:
            return self.then(self)
        return Block([self.sent / 50.0], np.zeros((1, self.n), np.float32), time.perf_counter())

    def close(self) -> None:
        pass


def silent(source):
    return None


def shorter(source):
    raise SkinMismatchError(f"{source.n - 1} values in a sample, its skin has {source.n} channels")


@pytest.fixture
def window_on(opengl, icub, prepared):
    """A window, off screen, on a source that a test makes; closed by the test's end."""
    from skinmap.live.loop import TouchLoop
    from viewer import Player, Scene
    from viewer.window import Window

    made = []

    def make(source):
        foot = prepared("left_foot")
        scene = Scene(
            icub, {"left_foot": foot.mesh}, {"left_foot": foot.flat}, links=("l_foot",),
            window_size=(400, 300),
        )  # fmt: skip
        window = Window(scene, Player(TouchLoop(icub, source, skins={"left_foot": foot})))
        made.append(window)
        return window

    yield make
    for window in made:
        window.close()


def turn_until(window, condition) -> None:
    end = time.monotonic() + 20.0
    window.player.start()
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        window.turn()
        window.wait()


def test_source_that_falls_silent_is_shown_as_stale(window_on, icub):
    window = window_on(Dying(icub, silent))
    # The words come with the first picture of it, which may be a turn later.
    turn_until(
        window, lambda: any("no data for" in text for text in window.scene.canvas.status.texts)
    )
    assert window.scene.moment.stale
    assert window.player.error is None


def test_source_that_comes_back_is_shown_again(window_on, icub):
    shown = []  # the window, once there is one

    def after_a_while(source):
        if not shown or not shown[0].scene.moment.stale:
            return None
        values = np.full((1, source.n), 40.0, np.float32)
        return Block([source.sent / 50.0], values, time.perf_counter())

    window = window_on(Dying(icub, after_a_while))
    shown.append(window)
    turn_until(window, lambda: window.scene.moment.stale)
    turn_until(window, lambda: not window.scene.moment.stale)
    # The next picture says so: moments come in between, from another thread.
    status = window.scene.canvas.status
    turn_until(window, lambda: not any("no data for" in text for text in status.texts))
    assert window.player.error is None


def test_source_that_changes_its_length_is_told_in_the_picture_and_at_the_end(window_on, icub):
    from viewer.window import run

    window = window_on(Dying(icub, shorter))
    turn_until(window, lambda: "values in a sample" in window.controls.notice.text)
    assert window.player.moment is not None, "the last picture stays"
    window.controls.close()
    with pytest.raises(SkinMismatchError, match="249 values in a sample, its skin has 250"):
        run(window)


def test_window_closed_in_mid_update_ends_quietly(window_on, icub):
    from skinmap.live.sources.open_source import open_source
    from viewer.window import run

    window = window_on(open_source("sim", robot=icub, parts=["left_foot"]))
    turn_until(window, lambda: window.drawn > 2)
    window.interactor.InvokeEvent("ExitEvent")
    assert run(window) == window.drawn
    assert not window.player._thread.is_alive()
    assert math.isfinite(window.player.oldest)


def test_calibrated_table_gives_the_uncertainty_of_each_taxel(tmp_path, icub, prepared):
    from skinmap.io.taxels.taxel_table import COLUMNS, COVARIANCE
    from viewer import Layers
    from viewer.inputs import read_covariances

    skin = icub.skin("left_foot")
    lines = [",".join((*COLUMNS, *COVARIANCE))]
    for row in range(len(skin))[::-1]:  # in any order
        place = ",".join(map(repr, [*skin.positions[row].tolist(), 0.0, 0.0, 1.0]))
        sd = 1e-3 * (1 + row)
        lines.append(f"{skin.channels[row]},0,{place},{sd**2},{sd**2 / 4},{sd**2 / 9},0,0,0")
    path = tmp_path / "taxels.csv"
    path.write_text("\n".join(lines) + "\n")
    for name in (str(path), f"left_foot={path}"):
        found = read_covariances([name], icub, ["left_foot"])["left_foot"]
        np.testing.assert_allclose(
            np.sqrt(found[:, 0, 0]), 1e-3 * (1 + np.arange(len(skin))), rtol=1e-9
        )
    plain = tmp_path / "plain.csv"
    plain.write_text("\n".join(",".join(line.split(",")[:8]) for line in lines) + "\n")
    with pytest.raises(DataFormatError, match="no covariances"):
        read_covariances([str(plain)], icub, ["left_foot"])
    with pytest.raises(SkinMismatchError, match="name it: PART=FILE"):
        read_covariances([str(path)], icub, ["torso"])
    shorter = tmp_path / "some.csv"
    shorter.write_text("\n".join(lines[:11]) + "\n")  # as skin that touches skin leaves it
    some = read_covariances([str(shorter)], icub, ["left_foot"])["left_foot"]
    assert np.isnan(some[:-10]).all()
    np.testing.assert_array_equal(some[-10:], found[-10:])
    skins = {"left_foot": prepared("left_foot")}
    layer = Layers(skins, covariances={"left_foot": some}).get("uncertainty")
    values = layer.values("left_foot", None)
    np.testing.assert_array_equal(np.isnan(values), np.isnan(some[:, 0, 0]))
    np.testing.assert_array_equal(layer.colours(values)[:-10], layer.colours(values)[[0] * 240])
    assert (layer.colours(values)[-10:] != layer.colours(values)[0]).any(axis=1).all()
    with pytest.raises(SkinMismatchError, match="is not one of the 430 taxels of 'torso'"):
        strange = tmp_path / "strange.csv"
        strange.write_text("\n".join([lines[0], "9999" + lines[1][lines[1].index(",") :]]) + "\n")
        read_covariances([f"torso={strange}"], icub, ["torso"])
    lines[3] = lines[3].replace(lines[3].split(",")[8], "-1")
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(DataFormatError, match="not a valid covariance"):
        read_covariances([str(path)], icub, ["left_foot"])


def test_size_and_range_are_the_pictures(model, tmp_path, opengl):
    import imageio.v3 as iio

    words = [*FOOT, "--model", str(model), "--screenshot"]
    pictures = {}
    for name, more in {
        "plain": {},
        "tall": {"size": [300, 500]},
        "hot": {"ranges": {"pressure": [0, 40]}},
    }.items():
        view(*words, str(tmp_path / f"{name}.png"), settings=more)
        pictures[name] = iio.imread(tmp_path / f"{name}.png")
    assert pictures["tall"].shape[:2] == (500, 300)
    assert (pictures["hot"] != pictures["plain"]).any(axis=2).mean() > 0.005


@pytest.mark.parametrize(
    ("text", "address"),
    [("8080", ("127.0.0.1", 8080)), ("0.0.0.0:80", ("0.0.0.0", 80)), ("robot:0", ("robot", 0)),
     (":90", ("127.0.0.1", 90)), ("[::1]:7", ("[::1]", 7))],
)  # fmt: skip
def test_address_of_the_page_is_read(text, address):
    assert parse_address(text) == address


@pytest.mark.parametrize(
    ("text", "said"),
    [("127.0.0.1:70000", "port 70000 does not exist"), ("icub", "got 'icub': write it last"),
     ("[::1]", "HOST:PORT"), ("robot:", "HOST:PORT"), ("", "HOST:PORT"), ("h:-1", "HOST:PORT")],
)  # fmt: skip
def test_address_that_does_not_exist_is_refused(text, said):
    with pytest.raises(UnreachableError, match=re.escape(said)):
        parse_address(text)


def test_token_comes_from_the_environment_or_the_file_it_names(monkeypatch, tmp_path):
    monkeypatch.delenv("SKINMAP_TOKEN", raising=False)
    assert read_token() is None
    monkeypatch.setenv("SKINMAP_TOKEN", "a" * 20)
    assert read_token() == "a" * 20
    (tmp_path / "token").write_text("b" * 20 + "\n")
    monkeypatch.setenv("SKINMAP_TOKEN", f"@{tmp_path / 'token'}")
    assert read_token() == "b" * 20
    monkeypatch.setenv("SKINMAP_TOKEN", "short")
    with pytest.raises(InvalidArrayError, match="16 to 128 letters"):
        read_token()


def test_a_picture_of_a_long_recording_looks_for_names_where_most_is_touched(
    tmp_path, icub, prepared
):
    from skinmap import save_recordings
    from skinmap.touch.recording import Recording
    from viewer.view_files import STRETCH, Wanted, fullest, write_files
    from viewer.view_options import Look, Session

    skin = prepared("left_foot").skin
    near = np.argsort(np.linalg.norm(skin.positions - skin.positions[40], axis=1))
    samples = np.zeros((3000, len(skin)), np.uint8)
    samples[200:300, near[:3]] = 90  # a small touch, and long after it a large one
    samples[2000:2100, near[:12]] = 90
    events = np.full(3000, -1)
    events[200:300], events[2000:2100] = 0, 1
    every = Recording(
        "left_foot", np.arange(3000) / 50.0, samples, events, ("poke", "poke"), np.zeros(2, int)
    )
    save_recordings([every], tmp_path / "long.npz")
    session = Session(icub, ("left_foot",), source=str(tmp_path / "long.npz"))
    session.prepare()
    start, seconds = fullest(session)
    assert start <= 40.0 < 42.0 <= start + STRETCH
    assert seconds == STRETCH
    shown = write_files(session, Look(), Wanted(screenshot=tmp_path / "a.png"))
    assert 40.0 <= shown.time < 42.0
    assert fullest(Session(icub, ("left_foot",))) == (0.0, None)  # the simulator has no end
    live = Session(icub, ("left_foot",), source="lsl:nobody sends this")
    assert fullest(live) == (0.0, None)  # and is not waited for


def test_part_is_framed_and_a_whole_robot_stays_whole(opengl):
    from viewer.drawing.frame.camera import project
    from viewer.view_options import Look, Session, new_scene

    robot = skinmap.load_robot("kaspar")
    shares = {}
    for parts in (("left_hand",), robot.parts):
        session = Session(robot, parts)
        session.prepare()
        scene = new_scene(session, Look(), size=(600, 400), off_screen=True)
        scene.update(360.0)
        hand = scene.layers["left_hand"]
        places = project(scene.canvas.renderer, scene.canvas.body.outline(scene.layers, close=True))
        assert (places >= 0).all()
        assert (places <= scene.canvas.renderer.GetSize()).all()
        points = project(
            scene.canvas.renderer, transform_points(scene.poses[hand.skin.link], hand.points)
        )
        shares[len(parts)] = float(np.ptp(points, axis=0).max()) / 400.0
        scene.close()
    assert shares[1] > 2.0 * shares[len(robot.parts)]
