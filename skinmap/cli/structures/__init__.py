"""`skinmap structures`: its options, its work, its result."""
