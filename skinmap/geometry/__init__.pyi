from skinmap.geometry.log_maps import log_map
from skinmap.geometry.proximity import (
    bridged_graph,
    closest_on_mesh,
    median_spacing,
    nearest_first,
    path_distances,
)
from skinmap.geometry.rigid import plane_turns, tangent_frames
from skinmap.geometry.topology import loops_by_length
from skinmap.geometry.triangles import TriangleMesh

__all__ = [
    "TriangleMesh",
    "bridged_graph",
    "closest_on_mesh",
    "log_map",
    "loops_by_length",
    "median_spacing",
    "nearest_first",
    "path_distances",
    "plane_turns",
    "tangent_frames",
]
