import numpy as np


def test_occluders_agree_with_the_placed_surface(opengl):
    import pyvista as pv

    from viewer.drawing.body.body_view import Occluders, Surface

    rng = np.random.default_rng(3)
    meshes = {"ball": pv.Sphere(radius=0.2), "box": pv.Cube(x_length=0.3), "none": pv.PolyData()}
    turn = np.array([[0.0, -1, 0, 0.5], [1, 0, 0, 0.1], [0, 0, 1, -0.2], [0, 0, 0, 1]])
    poses = {"ball": turn, "box": np.linalg.inv(turn), "none": np.eye(4)}
    links = Occluders(meshes, {link: np.eye(4) for link in meshes})
    links.place(poses)
    placed = Surface(
        pv.merge([meshes[k].transform(poses[k], inplace=False) for k in ("ball", "box")])
    )
    starts, ends = rng.uniform(-1.5, 1.5, (2, 300, 3))
    found = [links.blocks(a, b) for a, b in zip(starts, ends, strict=True)]
    assert found == [placed.blocks(a, b) for a, b in zip(starts, ends, strict=True)]
    assert 20 < sum(found) < 280
