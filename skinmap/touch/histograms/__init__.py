"""Histograms of periodic structures: codebooks, and the votes of taxels for their words."""
