"""Model files: they come back as they were, and damaged or hostile ones do nothing."""

from __future__ import annotations

import io
import json
import pickle
import sys
import types
import zipfile
from pathlib import Path

import numpy as np
import pytest
from sklearn.base import BaseEstimator
from sklearn.preprocessing import FunctionTransformer
from skops.io import dumps

from skinmap.errors import DataFormatError, MissingFileError, SkinWarning, UnknownNameError
from skinmap.recognition import model_file
from skinmap.recognition.check import planted_touches
from skinmap.recognition.classifier import TouchClassifier, classifiers
from skinmap.recognition.histograms.intersection import IntersectionSVC
from skinmap.recognition.model_file import FORMAT, load_classifier, save_classifier
from skinmap.skin.skin import Skin, skin_from_points
from skinmap.touch.prepared_skin import TrainedSkin, compare_skin

BUILT_IN = ("histogram", "raw-rbf", "contact-geometry", "histogram-sqrt")


@pytest.fixture(scope="module")
def touches():
    return planted_touches(8, rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def trained(touches):
    rng = np.random.default_rng(1)
    return {name: classifiers.get(name)().fit(touches, rng=rng) for name in BUILT_IN}


@pytest.fixture
def saved(trained, tmp_path):
    path = tmp_path / "m.skinmodel"
    save_classifier(trained["histogram"], path)
    return path


def rewrite(path, **changes):
    """The same file with some of its files changed, added or (None) left out."""
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    files.update({name.replace("__", "."): data for name, data in changes.items()})
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            if data is not None:
                archive.writestr(name, data)


def head(path):
    with zipfile.ZipFile(path) as archive:
        return json.loads(archive.read("model.json"))


def test_the_same_model_is_the_same_file_at_any_time(trained, tmp_path, monkeypatch):
    files = []
    for year in (2001, 2030):
        monkeypatch.setattr(zipfile.time, "localtime", lambda *_, y=year: (y, 1, 1, 0, 0, 0))
        save_classifier(trained["contact-geometry"], tmp_path / f"{year}.skinmodel")
        files.append((tmp_path / f"{year}.skinmodel").read_bytes())
    assert files[0] == files[1]


class Bomb:
    """Writes a file as soon as it is unpickled."""

    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self):
        return (Path.touch, (self.target,))


@pytest.mark.parametrize("name", BUILT_IN)
def test_models_come_back_with_all_that_they_know(trained, touches, tmp_path, name):
    save_classifier(trained[name], tmp_path / "m.skinmodel")
    back = load_classifier(tmp_path / "m.skinmodel")
    assert back.name == name
    assert back.labels == trained[name].labels
    assert [one.fingerprint for one in back.trained_on] == [
        one.fingerprint for one in trained[name].trained_on
    ]
    for touch in touches[::4]:
        np.testing.assert_array_equal(back.probabilities(touch), trained[name].probabilities(touch))


def test_the_head_names_format_versions_and_skins(saved):
    told = head(saved)
    assert told["format"] == FORMAT
    assert set(told["versions"]) == {"skinmap", "numpy", "scikit-learn", "skops"}
    (skin,) = told["skins"]
    assert (skin["part"], skin["taxels"], len(skin["fingerprint"])) == ("planted", 120, 64)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(MissingFileError, match="a model made by `skinmap train`"):
        load_classifier(tmp_path / "gone.skinmodel")


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_truncated_files_are_refused(saved, share):
    whole = saved.read_bytes()
    saved.write_bytes(whole[: int(len(whole) * share)])
    with pytest.raises(DataFormatError, match="not a Skinmap model"):
        load_classifier(saved)


def test_flipped_bytes_never_end_in_a_foreign_error(saved, rng):
    whole = bytearray(saved.read_bytes())
    for place in rng.choice(len(whole), 40, replace=False):
        spoilt = whole.copy()
        spoilt[place] ^= 0xFF
        saved.write_bytes(bytes(spoilt))
        try:
            model = load_classifier(saved)
        except (DataFormatError, UnknownNameError):
            continue
        assert isinstance(model, TouchClassifier)  # a byte that means nothing


@pytest.mark.parametrize(
    "name", ["model__json", "skins__npz", "descriptor__npz", "estimator__skops"]
)
@pytest.mark.parametrize("data", [None, b"", b"hello", b"PK\x05\x06" + 18 * b"\0"])
def test_files_inside_that_are_missing_or_empty_are_refused(saved, name, data):
    rewrite(saved, **{name: data})
    with pytest.raises(DataFormatError):
        load_classifier(saved)


def test_another_format_is_refused_by_name(saved):
    rewrite(saved, model__json=json.dumps({**head(saved), "format": "skinmap-model-99"}))
    with pytest.raises(DataFormatError, match="'skinmap-model-99', expected 'skinmap-model-4'"):
        load_classifier(saved)


def test_other_versions_are_told(saved):
    told = head(saved)
    told["versions"]["scikit-learn"] = "0.1.2"
    rewrite(saved, model__json=json.dumps(told))
    with pytest.warns(SkinWarning, match=r"made with scikit-learn 0\.1\.2 \(here \d"):
        load_classifier(saved)


def test_an_unknown_classifier_is_named(saved):
    rewrite(saved, model__json=json.dumps({**head(saved), "classifier": "oracle"}))
    with pytest.raises(
        UnknownNameError, match="no classifier 'oracle'; the classifiers are: contact"
    ):
        load_classifier(saved)


@pytest.mark.parametrize("name", ["skins__npz", "descriptor__npz", "estimator__skops"])
def test_pickles_are_never_unpickled(saved, tmp_path, name):
    target = tmp_path / "executed"
    bomb = pickle.dumps(Bomb(target))
    arrays = io.BytesIO()
    np.savez(arrays, **{"0": np.array([Bomb(target)], dtype=object)}, allow_pickle=True)
    for data in (bomb, arrays.getvalue()):
        rewrite(saved, **{name: data})
        with pytest.raises(DataFormatError):
            load_classifier(saved)
    assert not target.exists()
    pickle.loads(bomb)  # the bomb is a live one
    assert target.exists()


def test_functions_in_an_estimator_are_refused(saved):
    rewrite(saved, estimator__skops=dumps(FunctionTransformer(func=save_classifier)))
    with pytest.raises(DataFormatError, match=r"refused: it holds .*save_classifier"):
        load_classifier(saved)


def test_a_model_of_an_earlier_layout_asks_to_be_trained_again(saved, monkeypatch):
    old = type("IntersectionSVC", (BaseEstimator,), {"__module__": "skinmap.classify.intersection"})
    monkeypatch.setitem(sys.modules, old.__module__, types.SimpleNamespace(IntersectionSVC=old))
    rewrite(saved, estimator__skops=dumps(old()))
    with pytest.raises(DataFormatError, match="made by an earlier version: train the model again"):
        load_classifier(saved)


def test_a_module_that_an_estimator_names_is_not_imported(saved, tmp_path, monkeypatch):
    (tmp_path / "hostile_module.py").write_text("raise SystemExit('imported')")
    monkeypatch.syspath_prepend(tmp_path)
    with zipfile.ZipFile(saved) as archive:
        inner = archive.read("estimator.skops")
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(inner)) as old, zipfile.ZipFile(buffer, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "schema.json":
                ours = b"skinmap.recognition.histograms.intersection"
                data = data.replace(ours, b"hostile_module")
            new.writestr(name, data)
    rewrite(saved, estimator__skops=buffer.getvalue())
    with pytest.raises(DataFormatError, match=r"refused: it holds hostile_module"):
        load_classifier(saved)


def test_another_estimator_than_the_classifiers_is_refused(saved, trained):
    rewrite(saved, estimator__skops=dumps(IntersectionSVC()))
    with pytest.raises(DataFormatError, match=r"its estimator is a IntersectionSVC, 'histogram'"):
        load_classifier(saved)


@pytest.mark.parametrize("name", ["../outside.txt", "/etc/outside.txt", "extra.py"])
def test_files_that_a_model_has_no_use_for_are_refused(saved, tmp_path, name):
    with zipfile.ZipFile(saved, "a") as archive:
        archive.writestr(name, "x")
    with pytest.raises(DataFormatError, match="refused: it holds files"):
        load_classifier(saved)
    assert not (tmp_path.parent / "outside.txt").exists()


@pytest.mark.parametrize("inside", [False, True])
def test_zip_bombs_are_refused_before_they_are_unpacked(saved, monkeypatch, inside):
    monkeypatch.setattr(model_file, "LARGEST", 2**20)  # a mebibyte, to keep the test small
    zeros = bytes(2**21)
    if inside:
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("0.npy", zeros)
        rewrite(saved, skins__npz=buffer.getvalue())
    else:
        rewrite(saved, skins__npz=zeros)
    assert saved.stat().st_size < 2**20
    with pytest.raises(DataFormatError, match=r"unpacks to \d+ bytes, a model has at most"):
        load_classifier(saved)


def test_arrays_that_do_not_fit_together_are_refused(saved):
    with (
        zipfile.ZipFile(saved) as archive,
        np.load(io.BytesIO(archive.read("descriptor.npz"))) as arrays,
    ):
        inner = dict(arrays)
    for name, value in (
        ("words", inner["words"][:, :, 1:]),
        ("offsets", inner["offsets"] * np.nan),
    ):
        buffer = io.BytesIO()
        np.savez(buffer, **{**inner, name: value})
        rewrite(saved, descriptor__npz=buffer.getvalue())
        with pytest.raises(DataFormatError, match="do not fit together"):
            load_classifier(saved)


def test_a_machine_is_kept_as_its_arrays_and_damaged_ones_are_refused(trained, tmp_path):
    path = tmp_path / "m.skinmodel"
    save_classifier(trained["contact-geometry"], path)
    assert set(head(path)["versions"]) == {
        "skinmap",
        "numpy",
    }  # nothing of another library is in it
    with zipfile.ZipFile(path) as archive:
        assert "estimator.skops" not in archive.namelist()
        with np.load(io.BytesIO(archive.read("estimator.npz"))) as arrays:
            sound = dict(arrays)
    damaged = {
        "weights": sound["weights"][:, 1:],
        "vectors": sound["vectors"] * np.nan,
        "scale": np.zeros_like(sound["scale"]),
        "classes": sound["classes"][[0, 0, *range(2, len(sound["classes"]))]],
    }
    for name, value in damaged.items():
        buffer = io.BytesIO()
        np.savez(buffer, **{**sound, name: value})
        rewrite(path, estimator__npz=buffer.getvalue())
        with pytest.raises(DataFormatError, match="not a Skinmap model: an RBF machine"):
            load_classifier(path)


def test_a_fingerprint_that_does_not_fit_is_refused(saved):
    told = head(saved)
    told["skins"][0]["fingerprint"] = "0" * 64
    rewrite(saved, model__json=json.dumps(told))
    with pytest.raises(DataFormatError, match="'planted' do not fit their fingerprint"):
        load_classifier(saved)


def moved(skin, step):
    return Skin(
        skin.part, skin.link, skin.channels, skin.modules, skin.positions + step, skin.normals
    )


@pytest.mark.parametrize("one_skin", [False, True])
def test_compare_skin_says_what_differs_and_whether_to_go_on(hexagons, one_skin):
    flat = np.column_stack([hexagons, np.zeros(len(hexagons))])
    skin = skin_from_points(flat, np.tile([0.0, 0, 1], (len(flat), 1)), part="arm")
    trained = [TrainedSkin(skin.part, skin.positions)]

    def compare(other):
        return compare_skin(trained, other, one_skin=one_skin)

    assert compare(skin).message == ""
    assert compare(moved(skin, 1e-9)).message == ""  # less than tables are written to
    small = compare(moved(skin, [2e-3, 0, 0]))
    assert small.message == "taxels of 'arm' moved by up to 2 mm"
    assert small.may_go_on
    large = compare(moved(skin, [0, 9e-3, 0]))
    assert "another layout: taxels moved by up to 9 mm, more than half the pitch" in large.message
    fewer = skin_from_points(flat[:-4], np.tile([0.0, 0, 1], (len(flat) - 4, 1)), part="arm")
    assert compare(fewer).message == "'arm' has 164 taxels, the model learnt it with 168"
    other = skin_from_points(flat, np.tile([0.0, 0, 1], (len(flat), 1)), part="leg")
    assert compare(other).message == "'leg' was not trained on (arm were)"
    for difference in (large, compare(fewer), compare(other)):
        assert difference.may_go_on is not one_skin


def test_classifiers_compare_by_what_they_read(trained, prepared):
    hand = prepared("left_hand").skin
    assert trained["histogram"].difference(hand).may_go_on
    assert not trained["raw-rbf"].difference(hand).may_go_on
