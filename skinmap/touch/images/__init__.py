"""Contact images: pressures on the flat map."""
