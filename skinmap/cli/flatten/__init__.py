"""`skinmap flatten`: its options, its work, its result."""
