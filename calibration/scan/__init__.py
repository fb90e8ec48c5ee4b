"""A 3D scan of a covered link, registered to its mesh."""
