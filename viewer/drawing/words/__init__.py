"""Words in the picture: labels, legend, status."""
