"""What the user does: keys, mouse, selection, the time slider, saved views."""
