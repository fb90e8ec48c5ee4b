"""The same scene drawn by viser, the peer of our page in `benchmarks/viewer/viewer_web.py`.

Two ways, as either may be its best. `meshes`: each part is one mesh of hexagons (six corners and
four triangles a taxel, as in our page), added again under its name where its colours changed, as
the colours of a mesh's corners cannot be set in place. `instances`: each part is a batch of one
hexagon for each taxel, whose colours are set in place. The body is sent once, with the same
triangles as ours; touches are labels, without outlines. Parts whose colours stay are not sent.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from skinmap.geometry.proximity import median_spacing
from skinmap.geometry.rigid import transform_points
from skinmap.live.moment import Moment
from skinmap.skin.robot import Robot
from skinmap.touch.prepared_skin import PreparedSkin
from viewer.drawing.body.bare_body import body_meshes
from viewer.export.gltf import CORNERS, DISC_SHARE, LIFT, disc_solid
from viewer.layers import Layers
from viewer.web.scene_data import CELL, triangles_of


class Viser:
    """A viser server that shows moments, at most so many a second.

    Parameters
    ----------
    robot : Robot
    skins : mapping of str to PreparedSkin
    moments : iterator of Moment
    rate : float
        Samples a second.
    way : {"meshes", "instances"}
    """

    def __init__(
        self,
        robot: Robot,
        skins: Mapping[str, PreparedSkin],
        moments: Iterator[Moment],
        rate: float,
        way: str,
    ) -> None:
        import viser

        self._way, self._batches = way, dict[str, Any]()
        self._layer = Layers(skins).get("pressure")
        self._moments, self._period = moments, 1.0 / rate
        self.server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        self.url = f"http://127.0.0.1:{self.server.get_port()}/"
        poses = robot.body.poses(robot.pose)
        for link, mesh in body_meshes(robot, cell=CELL).items():
            points = transform_points(poses[link], np.asarray(mesh.points, np.float64))
            self.server.scene.add_mesh_simple(
                f"/body/{link}",
                points.astype(np.float32),
                triangles_of(mesh),
                color=(166, 176, 187),
            )
        self._skins = dict(skins)
        self._discs: dict[str, tuple[NDArray[np.float32], NDArray[Any], NDArray[Any]]] = {}
        for part, skin in skins.items():
            solid, owner = disc_solid(skin.skin)
            points = transform_points(poses[solid.link], solid.vertices).astype(np.float32)
            self._discs[part] = (points, solid.faces, owner)
        self._poses = {part: poses[skin.skin.link] for part, skin in skins.items()}
        self._shown: dict[str, NDArray[np.uint8]] = {}
        self.samples, self.seconds = 0, 0.0
        self.size = 0  # bytes of the arrays sent after the first sample, without their envelopes
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(5)
        self.server.stop()

    def _run(self) -> None:
        due = time.perf_counter()
        while not self._stop.is_set():
            self.show(next(self._moments))
            due = max(due + self._period, time.perf_counter() - self._period)
            self._stop.wait(max(0.0, due - time.perf_counter()))

    def show(self, moment: Moment) -> None:
        """Send a moment: meshes whose colours changed, and the labels."""
        began = time.thread_time()
        with self.server.atomic():
            for part, (points, faces, owner) in self._discs.items():
                colours = self._layer.colours(self._layer.values(part, moment))
                if part in self._shown and np.array_equal(colours, self._shown[part]):
                    continue
                first = part not in self._shown
                self._shown[part] = colours
                if not first:
                    sent = (points, faces.astype(np.uint32), colours[owner])
                    self.size += sum(
                        a.nbytes for a in (sent if self._way == "meshes" else (colours,))
                    )
                if self._way == "meshes":
                    self._add(part, points, faces, colours[owner])
                elif part in self._batches:
                    self._batches[part].batched_colors = colours
                else:
                    self._batches[part] = self._batch(part, colours)
            for number, touch in enumerate(moment.touches):
                place = transform_points(self._poses[touch.part], touch.centre[None])[0]
                self.server.scene.add_label(f"/touch/{number}", touch.label, position=tuple(place))
        self.samples += 1
        self.seconds += time.thread_time() - began

    def _add(
        self,
        part: str,
        points: NDArray[np.float32],
        faces: NDArray[Any],
        colours: NDArray[np.uint8],
    ) -> None:
        import trimesh

        mesh = trimesh.Trimesh(points, faces, vertex_colors=colours, process=False)
        self.server.scene.add_mesh_trimesh(f"/skin/{part}", mesh)

    def _batch(self, part: str, colours: NDArray[np.uint8]) -> Any:
        """One hexagon for each taxel, turned from z to its normal."""
        pose, skin = self._poses[part], self._skins[part].skin
        places = transform_points(pose, skin.positions + LIFT * skin.normals)
        x, y, z = (skin.normals @ pose[:3, :3].T).T
        turns = np.stack([1 + z, -y, x, np.zeros_like(z)], axis=1)
        turns[z < -1 + 1e-9] = (0.0, 1.0, 0.0, 0.0)
        angle = np.arange(CORNERS) * 2 * np.pi / CORNERS
        ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        return self.server.scene.add_batched_meshes_simple(
            f"/skin/{part}",
            (DISC_SHARE * median_spacing(skin.positions) * ring).astype(np.float32),
            np.array([[0, k, k + 1] for k in range(1, CORNERS - 1)], np.uint32),
            batched_wxyzs=turns / np.linalg.norm(turns, axis=1, keepdims=True),
            batched_positions=places,
            batched_colors=colours,
            cast_shadow=False,
            receive_shadow=False,
            lod="off",
        )
