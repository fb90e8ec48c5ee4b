"""Arrays in, arrays out: triangles, topology, proximity, distances, rigid transforms."""
