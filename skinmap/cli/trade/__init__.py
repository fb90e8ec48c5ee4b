"""`skinmap trade`: its options, its work, its result."""
