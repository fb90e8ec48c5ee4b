"""Public functions take names and files, and answer a wrong type with a line of the house."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import skinmap


@pytest.fixture(scope="module")
def skin():
    return skinmap.load_robot("kaspar").skin("torso")


WRONG = {
    "flatten of a number": (lambda s: skinmap.flatten(5), "mesh must be SurfaceMesh, not int"),
    "flatten of nothing": (lambda s: skinmap.flatten(None), "not NoneType"),
    "flatten without a part": (lambda s: skinmap.flatten("icub"), "add part="),
    "flatten of no robot": (lambda s: skinmap.flatten("icbu", part="torso"), "did you mean 'icub'"),
    "flatten of no part": (lambda s: skinmap.flatten("icub", part="nose"), "no part 'nose'"),
    "flatten a part of a skin": (lambda s: skinmap.flatten(s, part="torso"), "part chooses a skin"),
    "flatten by a number": (lambda s: skinmap.flatten(s, method=5), "method must be str"),
    "flatten with a stranger": (lambda s: skinmap.flatten(s, colour=1), "no parameter 'colour'"),
    "flatten without anything": (lambda s: skinmap.flatten(), "flatten needs mesh"),
    "surface of points": (lambda s: skinmap.build_surface([[1, 2]]), "skin must be Skin, not list"),
    "structures of points": (lambda s: skinmap.find_structures(np.eye(3)), "not ndarray"),
    "simulate a robot": (lambda s: skinmap.simulate(skinmap.load_robot("icub")), "add part="),
    "simulate many": (lambda s: skinmap.simulate(s, per_gesture="many"), "per_gesture must be int"),
    "train on a number": (lambda s: skinmap.train(3, "icub"), "recordings must be"),
    "train on no file": (lambda s: skinmap.train("nope.npz", "icub"), "no file 'nope.npz'"),
    "train without a robot": (lambda s: skinmap.train([]), "train needs robot"),
    "classify by a number": (lambda s: skinmap.classify("a.npz", 2, "icub"), "no file"),
    "load a robot of a number": (lambda s: skinmap.load_robot(5), "robot must be str"),
    "load a recording of a number": (lambda s: skinmap.load_recordings(5), "path must be str"),
    "load a model of a number": (lambda s: skinmap.load_classifier(4), "must be str"),
    "save a number": (lambda s: skinmap.save_recordings(1, "a.npz"), "recordings must be"),
    "record a number": (lambda s: skinmap.record(5), "source must be"),
    "open a number": (lambda s: skinmap.open_source(7), "spec must be str"),
    "histograms of a number": (lambda s: skinmap.histograms(1, 2), "codebook must be Codebook"),
    "codebook of a number": (lambda s: skinmap.learn_codebook(5), "skins must be"),
    "mount of numbers": (lambda s: skinmap.fit_mount(1, 2), "fit_mount"),
    "plane of numbers": (lambda s: skinmap.fit_plane(1, 2, 3), "contacts must be PlaneContacts"),
    "layout of a number": (lambda s: skinmap.wrap_layout(1), "wrap_layout"),
}


@pytest.mark.parametrize("call", WRONG)
def test_wrong_argument_is_named(call, skin):
    function, words = WRONG[call]
    with pytest.raises(skinmap.SkinError) as error:
        function(skin)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_name_works_where_an_object_does(skin):
    flat = skinmap.flatten("kaspar", part="torso")
    np.testing.assert_array_equal(flat.uv, skinmap.flatten(skinmap.build_surface(skin)).uv)
    found = skinmap.find_structures("kaspar", part="torso")
    assert len(found.prototypes) == len(skinmap.find_structures(flat).prototypes)


def test_recordings_and_models_may_be_files(skin, tmp_path):
    touches = skinmap.simulate(skin, per_gesture=6)
    skinmap.save_recordings(touches, tmp_path / "touches.npz")
    skinmap.train(tmp_path / "touches.npz", "kaspar").save(tmp_path / "touch.skinmodel")
    named = skinmap.classify(
        str(tmp_path / "touches.npz"), str(tmp_path / "touch.skinmodel"), "kaspar"
    )
    assert len(named) >= 24


def test_public_function_is_found_again_in_another_process():
    assert pickle.loads(pickle.dumps(skinmap.flatten)) is skinmap.flatten


def test_names_are_those_that_functions_take(skin):
    assert set(skinmap.robots()) >= {"icub", "kaspar"}
    recording = skinmap.simulate(skin, per_gesture=1, gestures=skinmap.gestures()[:2])
    assert set(recording.labels) == set(skinmap.gestures()[:2])
    assert "balanced" in skinmap.flatteners()
    assert "contact-geometry" in skinmap.classifiers()


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_flat_map_and_mesh_write_their_figures(skin, tmp_path, suffix):
    mesh = skinmap.build_surface(skin)
    heads = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}
    for thing in (mesh, skinmap.flatten(mesh)):
        file = thing.save(tmp_path / f"figure{suffix}")
        assert file.read_bytes().startswith(heads[suffix])
    with pytest.raises(skinmap.OutputError, match=r"\.png, \.svg or \.pdf"):
        mesh.save(tmp_path / "figure.txt")
    assert mesh.plot().axes


def test_charts_are_shown_in_a_line(skin):
    chart = skinmap.flatten(skin).charts[0]
    assert len(repr(chart)) < 120
    assert len(repr(chart.distortion)) < 120
