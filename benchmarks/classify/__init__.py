"""Classifiers: speed and accuracy."""
