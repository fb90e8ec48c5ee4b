"""From samples to named touches, while they happen."""
