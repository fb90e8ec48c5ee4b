"""Time and memory over decades of size."""
