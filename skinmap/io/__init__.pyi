from skinmap.io.output import staged_file, staged_folder
from skinmap.io.robots.manifest import load_robot
from skinmap.io.robots.mesh_file import read_mesh
from skinmap.io.taxels.taxel_table import read_taxels, write_csv

__all__ = [
    "load_robot",
    "read_mesh",
    "read_taxels",
    "staged_file",
    "staged_folder",
    "write_csv",
]
