"""Recording samples while they come."""
