"""Speed against accuracy: settings measured on a user's own skin and machine, and recommended."""
