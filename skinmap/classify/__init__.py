"""Classifiers of touches: contact geometry (the default), histograms, and how well they do."""
