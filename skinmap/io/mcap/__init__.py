"""Recordings in MCAP: written so that a kill leaves a file that opens, read whatever happened."""
