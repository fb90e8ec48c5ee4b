"""`skinmap inspect`: its options, its work, its result."""
