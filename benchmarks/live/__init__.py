"""The live loop, its transports and its recordings."""
