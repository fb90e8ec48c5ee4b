"""The scene in a browser: one small page, served to this machine only."""
