"""What every benchmark uses, and the run of all areas."""
