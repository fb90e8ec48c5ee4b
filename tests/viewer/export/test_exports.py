"""glTF: what is in it; and exports that cannot be written."""

from __future__ import annotations

import numpy as np
import pytest

from skinmap.errors import OutputError
from skinmap.geometry.rigid import transform_points
from skinmap.live.contacts.named_touch import Moment


@pytest.fixture
def touched(at_rest, press):
    """The small scene with one named touch on the chest."""
    pressures, touch = press("torso", 100)
    still = np.zeros(len(at_rest.layers["left_arm"].skin))
    at_rest.show_moment(Moment(1.0, {"torso": pressures, "left_arm": still}, (touch,)))
    at_rest.update()
    return at_rest


def test_gltf_holds_links_and_taxels_at_their_places_and_colours(touched, tmp_path):
    import trimesh

    from viewer.export.html_page import T_GLTF_WORLD, write_gltf

    path = write_gltf(touched, tmp_path / "scene.glb")
    scene = trimesh.load(path)
    assert set(scene.geometry) == {"chest", "l_upper_arm", "skin torso", "skin left_arm"}
    skin = touched.layers["torso"].skin
    placed = scene.geometry["skin torso"].copy()
    placed.apply_transform(scene.graph["skin torso"][0])
    pose = T_GLTF_WORLD @ touched.poses[skin.link]
    centres = np.asarray(placed.vertices).reshape(len(skin), 6, 3).mean(axis=1)
    away = np.linalg.norm(centres - transform_points(pose, skin.positions), axis=1)
    assert away.max() < 1e-6, "discs stand on their taxels, in single floats"
    colours = scene.geometry["skin torso"].visual.vertex_colors.reshape(len(skin), 6, 4)
    wanted = touched.layer.colours(touched.layer.values("torso", touched.moment))
    assert np.array_equal(colours[:, 0, :3], wanted)
    assert len(np.unique(wanted, axis=0)) > 3


def test_exports_into_no_folder_are_refused(touched, tmp_path):
    from viewer import write_gltf, write_html

    for write, name in ((write_gltf, "a.glb"), (write_html, "a.html")):
        with pytest.raises(OutputError, match="cannot write"):
            write(touched, tmp_path / "no" / name)
