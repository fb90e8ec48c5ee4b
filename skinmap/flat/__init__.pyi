from skinmap.flat.costs import face_metric
from skinmap.flat.distortion import Distortion, measure_distortion
from skinmap.flat.flat_map import Chart, FlatMap, flatten
from skinmap.flat.mesh_charts import flatten_mesh
from skinmap.flat.methods import flatteners

__all__ = [
    "Chart",
    "Distortion",
    "FlatMap",
    "face_metric",
    "flatten",
    "flatten_mesh",
    "flatteners",
    "measure_distortion",
]
