"""The Delaunay surface mesh over the taxels."""
