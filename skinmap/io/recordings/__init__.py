"""Recordings of all formats, in and out."""
