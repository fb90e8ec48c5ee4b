"""Public functions take names and files, and answer a wrong type with a line of the house."""

from __future__ import annotations

import inspect
import pickle

import numpy as np
import pytest

import skinmap
from skinmap.errors import InvalidArrayError


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
    "flatten with a stranger": (
        lambda s: skinmap.flatten(s, colour=1),
        "argument 'colour'; it takes",
    ),
    "flatten without anything": (lambda s: skinmap.flatten(), "argument: 'mesh'"),
    "surface of points": (lambda s: skinmap.build_surface([[1, 2]]), "skin must be Skin, not list"),
    "structures of points": (lambda s: skinmap.find_structures(np.eye(3)), "not ndarray"),
    "simulate a robot": (lambda s: skinmap.simulate(skinmap.load_robot("icub")), "add part="),
    "simulate many": (lambda s: skinmap.simulate(s, per_gesture="many"), "per_gesture must be int"),
    "train on a number": (lambda s: skinmap.train(3, "icub"), "recordings must be"),
    "train on no file": (lambda s: skinmap.train("nope.npz", "icub"), "no file 'nope.npz'"),
    "train without a robot": (lambda s: skinmap.train([]), "argument: 'robot'"),
    "classify by a number": (lambda s: skinmap.classify("a.npz", 2, "icub"), "no file"),
    "load a robot of a number": (lambda s: skinmap.load_robot(5), "robot must be str"),
    "load a recording of a number": (lambda s: skinmap.load_recordings(5), "path must be str"),
    "load a model of a number": (lambda s: skinmap.load_classifier(4), "must be str"),
    "save a number": (lambda s: skinmap.save_recordings(1, "a.npz"), "recordings must be"),
    "record a number": (lambda s: skinmap.record(5), "source must be"),
    "open a number": (lambda s: skinmap.open_source(7), "spec must be str"),
    "open by position": (lambda s: skinmap.open_source("sim", "icub"), "too many positional"),
    "examine nothing": (lambda s: skinmap.examine(None), "examine"),
    "contacts of words": (lambda s: skinmap.find_contacts(s, "hard"), "1 pressures for the 240"),
    "histograms of a number": (lambda s: skinmap.histograms(1, 2), "codebook must be Codebook"),
    "codebook of a number": (lambda s: skinmap.learn_codebook(5), "skins must be"),
    "mount of numbers": (lambda s: skinmap.fit_mount(1, 2), "fit_mount"),
    "plane of numbers": (lambda s: skinmap.fit_plane(1, 2, 3), "contacts must be PlaneContacts"),
    "layout of a number": (lambda s: skinmap.wrap_layout(1), "wrap_layout"),
    "avoid no taxel": (
        lambda s: skinmap.flatten(s, avoid=[1000]),
        "avoid must hold numbers",
    ),
    "avoid half a taxel": (lambda s: skinmap.flatten(s, avoid=[1.5]), "0 to 239"),
    "cut to no taxel": (lambda s: skinmap.flatten(s, cuts=[[1, 500]]), "cuts must hold numbers of"),
    "cut at one taxel": (lambda s: skinmap.flatten(s, cuts=[1, 2, 3]), "in pairs, 0 to 239"),
    "half an iteration": (
        lambda s: skinmap.flatten(s, iterations=2.5),
        "a whole number, 1 or more",
    ),
    "part of nothing": (lambda s: skinmap.load_robot("icub").skin(None), "no part 'None'; the"),
    "part of a list": (lambda s: skinmap.load_robot("icub").skin(["torso"]), "no part \"['torso']"),
    "image of a number": (
        lambda s: skinmap.contact_image(skinmap.flatten(s), np.zeros(240), shape=66),
        "shape must be (rows, columns), got 66",
    ),
    "codebook turned round": (
        lambda s: skinmap.learn_codebook(
            [(np.zeros((2, 240)), skinmap.find_structures(skinmap.flatten(s)))], rng=0
        ),
        "pairs (Structures, samples)",
    ),
    "codebook of no sample": (
        lambda s: skinmap.learn_codebook(
            [(skinmap.find_structures(skinmap.flatten(s)), np.zeros((0, 240)))], rng=0
        ),
        "a codebook needs samples",
    ),
    "contacts of texts": (lambda s: skinmap.find_contacts(s, ["1"] * 240), "must be numbers"),
    "simulate none": (lambda s: skinmap.simulate(s, per_gesture=0), "per_gesture must be a whole"),
    "simulate less": (lambda s: skinmap.simulate(s, per_gesture=-1), "per_gesture must be a whole"),
    "simulate no kind": (lambda s: skinmap.simulate(s, gestures=[]), "number of gestures must be"),
    "simulate nobody": (lambda s: skinmap.simulate(s, subjects=0), "subjects must be a whole"),
    "simulate nan": (lambda s: skinmap.simulate(s, variety=np.nan), "variety must lie in 0..2"),
    "simulate at home": (lambda s: skinmap.simulate(s, places="home"), "no place 'home'"),
    "simulate without luck": (lambda s: skinmap.simulate(s, rng=-1), "a seed must be 0 or more"),
    "save nothing": (lambda s: skinmap.save_recordings([], "a.npz"), "no recording to write"),
    "save turned round": (
        lambda s: skinmap.save_recordings("new.npz", skinmap.simulate(s, per_gesture=1)),
        "path must be str | Path, not Recording",
    ),
    "save to no folder": (
        lambda s: skinmap.save_recordings(skinmap.simulate(s, per_gesture=1), "nodir/x.npz"),
        "cannot write 'nodir/x.npz'",
    ),
    "save a table": (
        lambda s: skinmap.save_recordings(skinmap.simulate(s, per_gesture=1), "x.csv"),
        "the formats are: .npz, .mcap",
    ),
    "classify arrays": (
        lambda s: skinmap.classify(np.zeros((9, 240)), skinmap.default_model(), "kaspar"),
        "recordings must be Recording",
    ),
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


def test_one_name_is_as_good_as_a_list_of_it(skin):
    assert set(skinmap.simulate(skin, per_gesture=1, gestures="poke").labels) == {"poke"}


def test_part_stands_in_signature_and_docstring():
    assert "part" in inspect.signature(skinmap.flatten).parameters
    assert "    part : str, optional" in skinmap.flatten.__doc__
    assert "part" not in inspect.signature(skinmap.train).parameters


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


def test_a_mesh_is_drawn_with_its_edges_and_taxels(skin):
    (axis, *_) = skinmap.build_surface(skin).plot().axes
    assert len(axis.collections) == 2
    assert len(axis.lines[0].get_xdata()) > 200


def test_charts_are_shown_in_a_line(skin):
    chart = skinmap.flatten(skin).charts[0]
    assert len(repr(chart)) < 120
    assert len(repr(chart.distortion)) < 120


def test_contacts_are_a_sequence_with_figures(skin, tmp_path):
    mesh = skinmap.build_surface(skin)
    pressures = np.zeros(len(skin))
    nearest = np.argsort(np.linalg.norm(skin.positions - skin.positions[0], axis=1))
    pressures[nearest[:8]] = 100.0
    pressures[nearest[-3:]] = 50.0
    found = skinmap.find_contacts(mesh, pressures)
    assert set(found[0].taxels) == set(nearest[:8])
    assert next(iter(found)).peak == 100.0
    assert len(list(found)) == len(found) == found.number.max() + 1
    assert found[-1].mean == 50.0
    assert len(found[:1]) == 1
    with pytest.raises(IndexError):
        found[99]
    assert len(repr(found)) < 120
    assert found.save(tmp_path / "contacts.png").stat().st_size > 10_000
    with pytest.raises(skinmap.SkinError, match=r"one sample \(240,\), not 2 samples"):
        skinmap.find_contacts(mesh, np.zeros((2, len(skin))))


def test_moment_of_a_loop_has_a_figure(tmp_path):
    robot = skinmap.load_robot("kaspar")
    loop = skinmap.TouchLoop(robot, skinmap.open_source("sim", robot=robot, speed=np.inf))
    moment = next(one for one in loop if one.touches)
    loop.close()
    assert moment.plot().axes
    moment.save(tmp_path / "moment.svg")
    assert moment.touches[0].part in (tmp_path / "moment.svg").read_text()
    bare = skinmap.Moment(0.0, moment.pressures)
    with pytest.raises(skinmap.SkinError, match="moment without skins"):
        bare.plot()


def test_defaults_are_those_of_the_commands(skin):
    flat = skinmap.flatten(skin)
    one, turned = skinmap.find_structures(flat, rotations=1), skinmap.find_structures(flat)
    assert len(turned.prototypes) < len(one.prototypes)
    assert turned.prototypes.rotations == 6


def test_a_loop_takes_names_and_files_and_ends_in_words(tmp_path):
    model = tmp_path / "m.skinmodel"
    skinmap.default_model().save(model)
    source = skinmap.open_source("sim", robot="kaspar", parts=["torso"], speed=np.inf)
    loop = skinmap.TouchLoop("kaspar", source, classifier=model)
    assert list(loop.skins) == ["torso"]
    source.close()
    with pytest.raises(EOFError, match="the source has ended"):
        while True:
            loop.step(0.1)
    for seconds in (0.0, -1.0, np.nan):  # NaN never ended
        with pytest.raises(InvalidArrayError, match="seconds must be above 0"):
            skinmap.record("sim", tmp_path / "r.mcap", seconds)
    assert not (tmp_path / "r.mcap").exists()


def test_millimetres_in_place_of_metres_are_named():
    flat = skinmap.flatten("kaspar", part="left_hand")
    for call in (
        lambda: skinmap.find_structures(flat, radius=8),
        lambda: skinmap.contact_image(flat, np.ones(len(flat.mesh.skin)), pitch=2),
    ):
        with pytest.raises(InvalidArrayError, match="is it in millimetres"):
            call()
