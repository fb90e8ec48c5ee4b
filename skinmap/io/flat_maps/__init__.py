"""Files of flat maps."""
