"""Movies, glTF and pages of a scene."""
