"""`skinmap classify`: of recordings and of live streams."""
