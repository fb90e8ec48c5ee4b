"""Sets of names with a promise, and how far a name is to be believed."""
