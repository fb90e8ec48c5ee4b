"""Touches: their outlines, marks and traces."""
