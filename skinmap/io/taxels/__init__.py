"""Taxel tables of all formats, in and out."""
