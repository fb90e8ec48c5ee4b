"""Evaluation protocols: the papers' tables, transfer between patches and robots, recordings."""
