"""The panel beside the body."""
