"""Touches: recordings, the simulator, contacts and their geometry, histograms."""
