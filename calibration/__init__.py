"""Calibration of skin patches: where every taxel is, how sure, and whether it works.

Nothing lives here yet; the first commands arrive with the calibration of new patches.
"""
