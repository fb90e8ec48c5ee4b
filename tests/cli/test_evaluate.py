from __future__ import annotations

import json
import socket
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from skinmap.cli.evaluate import protocol_papers
from skinmap.cli.evaluate.protocol_recordings import lines
from skinmap.cli.main import cli
from skinmap.errors import InvalidArrayError, SkinError
from skinmap.recognition.protocols import kaspar
from skinmap.recognition.protocols.results import LeakRow
from skinmap.touch.recording import load_recordings, save_recordings
from skinmap.touch.simulation.simulator import simulate

PART = "left_forearm"
PNG = b"\x89PNG"


def run(*words: str) -> dict:
    result = CliRunner().invoke(cli, ["evaluate", *words, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def recording(icub, tmp_path_factory):
    path = tmp_path_factory.mktemp("recordings") / "touches.npz"
    touches = simulate(icub.skin(PART), rng=np.random.default_rng(3), per_gesture=7, variety=0.0)
    save_recordings([touches], path)
    return path


@pytest.fixture
def small_paper(monkeypatch):
    """The first paper's protocol with a tenth of its samples."""
    monkeypatch.setattr(kaspar, "SAMPLES", dict.fromkeys(kaspar.SAMPLES, 200))
    monkeypatch.setattr(kaspar, "PERCENTS", (20,))
    monkeypatch.setattr(kaspar, "RADII", (0.0055, 0.008))


def documented(result: dict) -> list[str]:
    """Keys of a result that docs/json.md does not name, names of gestures and parts apart."""
    text = (Path(__file__).parents[2] / "docs" / "json.md").read_text()
    rows = [row for value in result.values() if isinstance(value, list) for row in value]
    keys = {*result, *(key for row in rows if isinstance(row, dict) for key in row)}
    return [key for key in sorted(keys) if f"`{key}`" not in text]


def test_kaspar_prints_the_table_beside_the_papers(small_paper, tmp_path):
    words = ("--protocol", "kaspar", "--part", "right_hand", "--seeds", "1")
    result = run(*words, "--out", str(tmp_path))
    for row in result["table"]:
        assert {"percent", "folds", "features", "classifier", "per_class", "mean", "std"} <= {*row}
        assert list(row["per_class"]) == ["poke", "full_finger", "three_finger", "whole_hand"]
    assert {row["folds"] for row in result["table"]} == {"plain", "event"}
    assert [row["percent"] for row in result["paper"]] == [2, 2, 10, 10]
    assert result["accuracy_is"] == "simulated"
    assert result["files"] == ["evaluation.json", "sweep.png", "report.html"]
    assert (tmp_path / "sweep.png").read_bytes().startswith(PNG)
    assert (tmp_path / "report.html").read_text().count("data:image/png;base64,") == 1
    assert json.loads((tmp_path / "evaluation.json").read_text())["table"] == result["table"]
    assert documented(result) == []


def test_cross_patch_prints_a_row_for_each_classifier(tmp_path):
    result = run(
        "--protocol", "cross-patch", "--robot", "icub", "--part", PART, "--part", "left_arm",
        "--seeds", "1", "--per-gesture", "5", "--set", "gestures=poke,full_finger,three_finger",
        "--classifier", "contact-geometry", "--out", str(tmp_path),
    )  # fmt: skip
    (row,) = result["rows"]
    assert {"features", "classifier", "mean", "worst", "per_patch", "per_class"} <= {*row}
    assert len(row["per_patch"]) == len(result["patches"]) == 6
    assert result["files"] == ["evaluation.json", "report.html"]
    assert documented(result) == []


def test_touches_vary_unless_they_are_asked_not_to():
    """The two are other touches, and the result holds which they were."""
    words = ("--protocol", "cross-patch", "--part", PART, "--part", "left_foot", "--seeds", "1")
    few = ("--per-gesture", "5", "--set", "gestures=poke,full_finger", "--classifier")
    varied, clean = (
        run(*words, *few, "contact-geometry", *how) for how in ((), ("--variety", "none"))
    )
    assert (varied["variety"], clean["variety"]) == (1.0, 0.0)
    assert varied["rows"] != clean["rows"]
    assert clean["rows"][0]["mean"] >= varied["rows"][0]["mean"]


def test_recordings_are_cross_validated_by_event_with_the_leak_beside(recording, tmp_path):
    words = (str(recording), "--classifier", "contact-geometry", "--seeds", "1")
    result = run(*words, "--out", str(tmp_path))
    assert result["touches"] == dict.fromkeys(
        ("full_finger", "poke", "three_finger", "whole_hand"), 7
    )
    assert [row["folds"] for row in result["table"]] == ["plain", "event"]
    assert result["leak"][0]["classifier"] == "contact-geometry"
    assert result["files"] == ["evaluation.json", "report.html"]
    assert documented(result) == []
    again = run("--protocol", *words)  # a recording may stand there as well
    assert again["table"] == result["table"]


def test_tables_are_printed_for_people(recording):
    words = ["evaluate", str(recording), "--classifier", "contact-geometry", "--seeds", "1"]
    result = CliRunner().invoke(cli, words, catch_exceptions=False)
    assert "plain folds flatter contact-geometry by" in result.stdout
    assert "7 full_finger, 7 poke" in result.stdout


def test_plain_folds_that_are_harder_are_not_told_by_a_negative_number():
    leak = [LeakRow(classifier="raw-rbf", points=-35.3), LeakRow(classifier="paper", points=3.0)]
    result = SimpleNamespace(
        touches={"poke": 7}, parts=["arm"], folds=4, table=[], seeds=[0], left_out=[], leak=leak,
        skipped={},
    )  # fmt: skip
    assert [*lines(result)][-2:] == [
        "plain folds are harder on raw-rbf by 35.3 points",
        "plain folds flatter paper by 3.0 points",
    ]


def test_methods_of_baxter_have_the_names_of_classifiers_too(monkeypatch):
    asked = []

    def kept(*_, methods, **others):
        asked.extend(methods)
        raise InvalidArrayError("enough")

    monkeypatch.setattr(protocol_papers, "evaluate_baxter", kept)
    for name in ("raw-rbf", "raw_rbf"):
        words = ["evaluate", "--protocol", "baxter", "--classifier", name]
        assert str(CliRunner().invoke(cli, words).exception) == "enough"
    assert asked == ["raw_rbf", "raw_rbf"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--protocol", "paper1"],
            "no protocol or recording 'paper1'; the protocols and recordings are: kaspar, baxter",
        ),
        (
            [],
            "name --protocol (kaspar, baxter, cross-patch, physics, time, fingers, hands, prints, "
            "force, load) or recordings",
        ),
        (["gone.npz"], "no file 'gone.npz'"),
        (["--protocol", "kaspar", "x.npz"], "simulates its touches: no recordings"),
        (["--protocol", "kaspar", "--robot", "icub"], "which part of icub? --part torso | "),
        (
            ["--protocol", "kaspar", "--robot", "icu"],
            "did you mean 'icub'?",
        ),
        (
            ["--protocol", "kaspar", "--part", "tail"],
            "no part 'tail'; the parts are: torso, right_arm",
        ),
        (["--protocol", "kaspar", "--classifier", "cnn"], "has its own classifiers"),
        (["--protocol", "cross-patch", "--classifier", "oracle"], "no classifier 'oracle'"),
        (["--protocol", "cross-patch", "--classifier", "raw-rbf"], "learns the taxels of one part"),
        (["--protocol", "cross-patch", "--set", "gestures=slap"], "no gesture 'slap'"),
        (
            ["--protocol", "cross-patch", "--part", "torso"],
            "two patches, got torso; give",
        ),
        (["--protocol", "baxter", "--classifier", "oracle"], "no method 'oracle'"),
        (["--protocol", "baxter", "--set", "images=9"], "Expected `int` >= 90"),
        (["--protocol", "baxter", "--set", "network=huge"], "Invalid enum value 'huge'"),
        (["--protocol", "baxter", "--set", "sweep=yes"], "settings of baxter: images, network"),
        (["--protocol", "physics", "--set", "folds"], "settings of physics: gestures"),
        (["--protocol", "kaspar", "--sweep"], "--sweep was removed: write --set sweep=yes"),
        (["--protocol", "kaspar", "--variety", "much"], "no variety level 'much'"),
        (["touches.npz", "--variety", "none"], "recorded touches have no --variety"),
        (["--protocol", "kaspar", "--per-gesture", "3"], "--per-gesture is of cross-patch, phys"),
        (["--protocol", "force", "--classifier", "svm"], "force trains no classifier: no --cl"),
        (["touches.npz", "--network", "paper"], "--network is of baxter; not of recordings"),
    ],
)
def test_what_cannot_be_evaluated_is_said_in_a_line(words, message):
    result = CliRunner().invoke(cli, ["evaluate", *words])
    assert result.exit_code != 0
    if isinstance(result.exception, SkinError):  # the entry point makes exit code 2 of it
        assert message in str(result.exception)
    else:
        assert result.exit_code == 2
        assert message in result.stderr


def test_recordings_that_do_not_fit_are_refused(recording, tmp_path):
    (one,) = load_recordings(recording)
    assert "240 taxels, the skin of iCub has 250" in refused(one, tmp_path, part="left_foot")
    assert "no part 'wing'" in refused(one, tmp_path, part="wing")
    assert "differ in spelling only" in refused(one, tmp_path, labels=("POKE",))
    few = CliRunner().invoke(cli, ["evaluate", str(recording), "--set", "folds=9"])
    assert "9 folds need two labels with at least 9 touch events each" in str(few.exception)


def refused(one, folder, *, part=PART, labels=()) -> str:
    from dataclasses import replace

    changed = replace(one, part=part, labels=(*labels, *one.labels[len(labels) :]))
    save_recordings([changed], folder / "changed.npz")
    result = CliRunner().invoke(cli, ["evaluate", str(folder / "changed.npz")])
    assert isinstance(result.exception, SkinError), result.output
    return str(result.exception)


def test_nobody_at_the_dask_address_ends_before_anything_is_simulated(monkeypatch):
    pytest.importorskip("distributed", reason="the extra dask is not installed")
    monkeypatch.setattr("skinmap.parallel.workers.CONNECT_SECONDS", 0.5)
    with socket.socket() as free:  # bound and not listening: connections are refused
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        words = ["evaluate", "--protocol", "kaspar", "--jobs", address]
        result = CliRunner().invoke(cli, words)
    assert isinstance(result.exception, SkinError)
    assert f"no Dask scheduler answers at '{address}'" in str(result.exception)
