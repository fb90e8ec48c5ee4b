from skinmap.surface.surface_mesh import SurfaceMesh, build_surface

__all__ = [
    "SurfaceMesh",
    "build_surface",
]
