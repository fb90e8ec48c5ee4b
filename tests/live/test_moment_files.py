"""Files of rerun: what is logged, and the real package where it is installed."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

import skinmap
from skinmap.cli.main import cli
from skinmap.errors import MissingLibraryError
from skinmap.live import Moment
from skinmap.live.contacts.named_touch import NamedTouch
from skinmap.live.moment_files import write_rerun


class Columns(dict):
    """What a type of rerun makes of columns."""

    def partition(self, sizes):
        return {**self, "sizes": sizes}


class Stream:
    """Notes all that is logged."""

    def __init__(self, *_, **__) -> None:
        self.logged, self.sent, self.now, self.open = [], [], None, True

    def save(self, path) -> None:
        self.path = path

    def set_time(self, timeline, *, duration) -> None:
        self.now = (timeline, duration)

    def log(self, entity, what, *, static=False) -> None:
        self.logged.append((entity, what, static, self.now))

    def send_columns(self, entity, indexes, columns) -> None:
        self.sent.append((entity, indexes[0], columns))

    def disconnect(self) -> None:
        self.open = False


class Anything:
    """An archetype: what it is made of."""

    def __init__(self, *args, **kwargs) -> None:
        self.args, self.kwargs = args, kwargs

    @classmethod
    def columns(cls, **kwargs):
        return Columns(kwargs)


@pytest.fixture
def streams(monkeypatch):
    made = []

    def new(*args, **kwargs):
        made.append(Stream())
        return made[-1]

    names = ("Mesh3D", "Points3D", "Transform3D", "Clear", "TextLog", "Scalars")
    fake = SimpleNamespace(
        RecordingStream=new,
        TimeColumn=lambda timeline, *, duration: (timeline, duration),
        **{name: type(name, (Anything,), {}) for name in names},
    )
    monkeypatch.setitem(sys.modules, "rerun", fake)
    return made


def moments(skin):
    quiet = np.zeros(len(skin))
    pressed = quiet.copy()
    pressed[3] = 200.0
    touch = NamedTouch(
        "torso", np.array([3]), skin.positions[3], "poke", 0.9, identity=1, area=2e-5
    )
    for step in range(50):
        felt = 20 <= step < 40
        yield Moment(
            1000.0 + 0.02 * step, {"torso": pressed if felt else quiet}, (touch,) if felt else ()
        )


def test_rerun_has_body_taxels_touches_and_plots(streams, tmp_path):
    robot = skinmap.load_robot("kaspar")
    skin = robot.skin("torso")
    assert write_rerun(moments(skin), robot, {"torso": skin}, tmp_path / "x.rrd") == 50
    (stream,) = streams
    assert not stream.open
    entities = [entity for entity, *_ in stream.logged]
    link = robot.part("torso").link
    assert f"world/{link}/mesh" in entities
    assert entities.count("touches") == 1  # one line of news for one touch
    centres = f"world/{link}/torso/touches"
    shown = [(what, now) for entity, what, _, now in stream.logged if entity == centres]
    assert len(shown) == 21  # twenty samples of it, and its end
    np.testing.assert_allclose(shown[0][0].args[0], [skin.positions[3]], rtol=1e-6)
    assert shown[0][1] == ("time", pytest.approx(0.4))
    assert type(shown[-1][0]).__name__ == "Clear"


def test_rerun_plots_every_sample_and_colours_ten_a_second(streams, tmp_path):
    robot = skinmap.load_robot("kaspar")
    skin = robot.skin("torso")
    write_rerun(moments(skin), robot, {"torso": skin}, tmp_path / "x.rrd")
    sent = {entity: (index, columns) for entity, index, columns in streams[0].sent}
    (_, times), values = sent["plots/torso/largest"]
    assert len(times) == 50
    assert max(values["scalars"]) == 200.0
    np.testing.assert_allclose(max(sent["plots/torso/area_mm2"][1]["scalars"]), 20.0)
    (_, when), colours = sent[f"world/{robot.part('torso').link}/torso/taxels"]
    assert colours["sizes"] == [240] * len(when)
    assert len(when) == 10
    rows = np.split(colours["colors"], len(when))
    assert (rows[5] != rows[0]).sum() == 1  # the taxel that is pressed


def test_rerun_that_is_not_installed_is_one_line(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "rerun", None)
    words = ["record", "sim", "--robot", "kaspar", "--part", "torso", "--seconds", "1"]
    one = tmp_path / "one.mcap"
    assert CliRunner().invoke(cli, [*words, "--speed", "inf", "-o", str(one)]).exit_code == 0
    out = tmp_path / "one.rrd"
    done = CliRunner().invoke(cli, ["export", str(one), "--format", "rrd", "-o", str(out)])
    assert isinstance(done.exception, MissingLibraryError)
    assert "pip install 'skinmap[rerun]'" in str(done.exception)
    assert not out.exists()


def test_rerun_of_its_own_package_opens(tmp_path):
    pytest.importorskip("rerun")
    robot = skinmap.load_robot("kaspar")
    skin = robot.skin("torso")
    write_rerun(moments(skin), robot, {"torso": skin}, tmp_path / "x.rrd")
    assert (tmp_path / "x.rrd").read_bytes()[:3] == b"RRF"
