import numpy as np
import pytest

from skinmap.errors import UnknownNameError
from skinmap.geometry.triangles import TriangleMesh


def test_drawable_is_light_near_the_original_and_shaded(opengl, icub):
    from skinmap.geometry.proximity import closest_on_mesh
    from viewer.drawing.body.bare_body import drawable

    mesh = icub.mesh("root_link")
    drawn = drawable(mesh, cell=6e-3)
    assert drawn.n_cells <= 0.6 * len(mesh.faces)
    points = np.asarray(drawn.points, float)
    distance, _, _ = closest_on_mesh(points, mesh.vertices, mesh.faces)
    # No vertex leaves its cell; means of a cell lie well inside.
    assert distance.max() < np.sqrt(3) * 6e-3
    assert np.quantile(distance, 0.95) < 1.5e-3
    normals = np.asarray(drawn.point_data["Normals"])
    length = np.linalg.norm(normals, axis=1)
    # Zero normals would be drawn black: only slivers without area may have them.
    assert (np.abs(length - 1.0) < 1e-3).mean() > 0.995


def test_drawable_takes_an_empty_mesh(opengl):
    from viewer.drawing.body.bare_body import drawable

    empty = TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    assert drawable(empty).n_cells == 0


def test_check_links_takes_those_under_the_skin(opengl, icub):
    from viewer.drawing.body.bare_body import check_links

    assert check_links(icub, "skin", ("torso", "left_arm")) == ("chest", "l_upper_arm")
    assert check_links(icub, "all") == icub.body.visible_links


def test_body_meshes_reads_only_the_links_asked_for(opengl):
    import skinmap
    from viewer.drawing.body.bare_body import body_meshes

    robot = skinmap.load_robot("icub")
    read = []
    original = robot.body.mesh
    robot.body.mesh = lambda link: read.append(link) or original(link)
    assert list(body_meshes(robot, ["l_hand"])) == ["l_hand"]
    assert read == ["l_hand"]


def test_check_links_names_what_exists(opengl, icub):
    from viewer.drawing.body.bare_body import check_links

    with pytest.raises(UnknownNameError, match=r"'r_forarm'.*r_forearm"):
        check_links(icub, ["r_forarm"])


def test_standing_pose_keeps_the_robot_upright_within_its_limits(icub):
    for joint, angle in icub.pose.items():
        low, high = icub.body.joints[joint]
        assert low <= angle <= high, joint
    poses = icub.body.poses(icub.pose)
    left, right = poses["l_foot"], poses["r_foot"]
    # Feet level with each other and flat on the floor.
    assert abs(left[2, 3] - right[2, 3]) < 2e-3
    zero = icub.body.poses({})
    for foot in ("l_foot", "r_foot"):
        turn = poses[foot][:3, :3] @ zero[foot][:3, :3].T
        assert turn[2, 2] > np.cos(np.radians(1.0))


def test_links_have_fewer_triangles_the_coarser_the_detail(opengl, icub, monkeypatch):
    from viewer.drawing.body import body_view
    from viewer.drawing.frame.canvas import new_plotter

    poses, counts = icub.body.poses(icub.pose), []
    for detail in (5.0, 15.0, 45.0):  # the mesh itself is as fine as 2 px
        plotter = new_plotter((320, 240), True, panel=False)
        monkeypatch.setattr(body_view, "GOOD_PX", detail)
        body = body_view.BodyView(plotter, icub, ("chest",), poses)
        counts.append(sum(mesh.n_cells for mesh in body.meshes.values()))
        plotter.close()
    # A cell three times as wide covers nine of the smaller: at least half of their triangles go.
    assert counts[1] < counts[0] / 2
    assert counts[2] < counts[1] / 2


def test_a_thin_plate_of_few_triangles_is_whole_and_flat_faces_are_flat(opengl, monkeypatch, icub):
    from viewer.drawing.body import bare_body

    across = np.array(np.meshgrid([0.0, 0.1], [0.0, 0.08], [0.0, 0.003])).reshape(3, -1).T
    faces = [[0, 1, 5], [0, 5, 4], [2, 6, 7], [2, 7, 3], [0, 2, 3], [0, 3, 1]]
    faces += [[4, 5, 7], [4, 7, 6], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]]
    plate = TriangleMesh(across, np.array(faces))
    monkeypatch.setattr(type(icub), "mesh", lambda robot, link: plate)
    for few in (bare_body.FEW, 0):  # whole, and as one of many triangles
        monkeypatch.setattr(bare_body, "FEW", few)
        (drawn,) = bare_body.body_meshes(icub, ["chest"], cell=6e-3).values()
        np.testing.assert_allclose(np.ptp(drawn.points, axis=0), [0.1, 0.08, 0.003], rtol=1e-5)
        if few:
            corners = np.asarray(drawn.points)[drawn.regular_faces]
            flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            flat /= np.linalg.norm(flat, axis=1)[:, None]
            shaded = np.asarray(drawn.point_data["Normals"])[drawn.regular_faces]
            np.testing.assert_allclose(shaded, np.repeat(flat[:, None], 3, axis=1), atol=1e-5)
