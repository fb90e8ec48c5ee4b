"""Recordings that MuJoCo's touches make."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from skinmap.cli.main import cli
from skinmap.errors import MissingLibraryError, UnknownNameError
from skinmap.io.recordings.touch_files import load_recordings
from skinmap.io.robots.manifest import load_robot
from skinmap.physics import pressing as engine
from skinmap.physics.bodies import PRESSERS
from skinmap.physics.simulation import make_ground, place_at, simulate
from skinmap.physics.variants import VARIANTS
from skinmap.skin.skin import Skin
from skinmap.touch.recording import Recording
from skinmap.touch.simulation.variety import Sensing

mujoco = pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")


@pytest.fixture(scope="module")
def forearm() -> Skin:
    return load_robot("icub").skin("left_forearm")


@pytest.fixture(scope="module")
def touches(forearm: Skin) -> Recording:
    return simulate(forearm, rng=np.random.default_rng(3), per_gesture=3)


def test_simulate_makes_all_four_gestures(touches: Recording) -> None:
    assert set(touches.labels) == {"poke", "full_finger", "three_finger", "whole_hand"}
    assert len(touches.labels) >= 10  # a hand may find no place on a forearm in sixty tries
    for _, _, samples in touches.touches():
        assert samples.max() > 12  # felt
    assert touches.pressures[touches.events < 0].mean() < 2.0  # and rest in between


def test_simulate_same_seed_same_touches(forearm: Skin, touches: Recording) -> None:
    again = simulate(forearm, rng=np.random.default_rng(3), per_gesture=3)
    np.testing.assert_array_equal(again.pressures, touches.pressures)
    other = simulate(forearm, rng=np.random.default_rng(4), per_gesture=3)
    assert not np.array_equal(other.pressures[:100], touches.pressures[:100])


def test_simulate_knows_force_and_place(forearm: Skin, touches: Recording) -> None:
    assert touches.forces is not None
    assert touches.places is not None
    for event, label, samples in touches.touches():
        own = touches.events == event
        at = int(np.argmax(touches.forces[own]))
        assert touches.forces[own][at] > 0.3
        if label == "poke":  # one spot: what is felt lies round the true place
            felt = samples[at].astype(float)
            felt[felt < 12] = 0.0
            centre = felt @ forearm.positions / felt.sum()
            assert np.linalg.norm(centre - touches.places[own][at]) < 6e-3
    resting = touches.events < 0
    assert not touches.forces[resting].any()
    assert np.isnan(touches.places[resting]).all()


@pytest.mark.parametrize("variant", VARIANTS)
def test_simulate_every_variant_presses(forearm: Skin, variant: str) -> None:
    made = simulate(
        forearm, rng=np.random.default_rng(0), per_gesture=1, variant=variant, gestures=["poke"]
    )
    assert made.labels == ("poke",)
    assert made.pressures.max() > 12


def test_simulate_keeps_the_rate(forearm: Skin) -> None:
    made = simulate(
        forearm,
        rng=np.random.default_rng(0),
        per_gesture=1,
        gestures=["poke"],
        sensing=Sensing(rate=33.0),
    )
    np.testing.assert_allclose(np.diff(made.times), 1 / 33.0)


def test_simulate_beyond_wide_leans_and_reaches_over_rims(forearm: Skin) -> None:
    how: dict[str, Any] = {"per_gesture": 3, "gestures": ["poke", "three_finger"]}
    one, same, other = (
        simulate(forearm, rng=np.random.default_rng(5), **how, **more)
        for more in ({}, {"variety": 1.0}, {"variety": 2.0})
    )
    np.testing.assert_array_equal(one.pressures, same.pressures)
    assert len(other.labels) == 6
    assert all(samples.max() > 20 for _, _, samples in other.touches())
    ground = make_ground(forearm, VARIANTS["foam"], rng=np.random.default_rng(0))
    presser = PRESSERS["poke"](np.random.default_rng(0), 0.9, ground.variant)
    taxel = len(forearm) // 2
    straight, leant = (place_at(ground.bed, presser, taxel, 0.3, lean) for lean in (0.0, 0.5))
    assert straight is not None
    assert leant is not None
    cosine = straight[0].frames[0, :3, 2] @ leant[0].frames[0, :3, 2]
    assert np.degrees(np.arccos(cosine)) == pytest.approx(np.degrees(np.arctan(0.5)), abs=2.0)


def test_simulate_refuses_unknown_names(forearm: Skin) -> None:
    with pytest.raises(UnknownNameError, match=r"no physics variant 'steel'; .* are: foam"):
        simulate(forearm, rng=np.random.default_rng(0), variant="steel")
    with pytest.raises(UnknownNameError, match="no gesture that MuJoCo presses 'wave'"):
        simulate(forearm, rng=np.random.default_rng(0), gestures=["wave"])


@pytest.fixture
def no_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> Any:
        raise ImportError(name)

    monkeypatch.setattr(engine, "import_module", missing)


@pytest.mark.usefixtures("no_mujoco")
def test_simulate_without_mujoco_names_the_extra(forearm: Skin, tmp_path: Path) -> None:
    with pytest.raises(MissingLibraryError, match=r"pip install 'skinmap\[mujoco\]'"):
        simulate(forearm, rng=np.random.default_rng(0))
    done = CliRunner().invoke(
        cli, ["simulate", "icub", "--physics", "mujoco", "-o", str(tmp_path / "t.npz")]
    )
    assert isinstance(done.exception, MissingLibraryError)  # exit 2 and this one line, see main()
    assert "pip install 'skinmap[mujoco]'" in str(done.exception)


def test_import_mujoco_refuses_an_old_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco, "__version__", "3.2.7")
    with pytest.raises(MissingLibraryError, match=r"MuJoCo 3\.2\.7 is too old"):
        engine.import_mujoco()


def test_simulate_command_writes_the_truth(tmp_path: Path) -> None:
    path = tmp_path / "t.npz"
    words = ["simulate", "icub", "--part", "left_hand", "--physics", "mujoco:flesh"]
    done = CliRunner().invoke(
        cli, [*words, "--gesture", "poke", "--per-gesture", "2", "-o", str(path)]
    )
    assert done.exit_code == 0, done.output
    (made,) = load_recordings(path)
    assert made.forces is not None
    assert made.places is not None
    assert made.forces.max() > 0.3


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--physics", "ours:foam"], "no physics 'ours:foam'"),
        (["--physics", "mujoco:x"], "no physics variant 'x'"),
        (["--physics", "mujoco", "--gesture", "pairs"], "leave out pairs"),
        (["--physics", "mujoco", "--fault", "foam-mm=3"], "leave out --fault foam-mm"),
        (["--physics", "mujoco", "--publish", "zmq:1"], "leave out --physics"),
    ],
)
def test_simulate_command_refuses(words: list[str], message: str, tmp_path: Path) -> None:
    output = [] if "--publish" in words else ["-o", str(tmp_path / "t.npz")]
    done = CliRunner().invoke(cli, ["simulate", "icub", *words, *output])
    assert done.exit_code != 0
    assert message in f"{done.stderr} {done.exception}"
    assert not (tmp_path / "t.npz").exists()
