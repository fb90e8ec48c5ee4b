"""The picture as a whole: canvas, camera, renderers."""
