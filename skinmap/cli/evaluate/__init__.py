"""`skinmap evaluate`: its options, its work, its result."""
