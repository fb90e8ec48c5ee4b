"""What every command is made of: options, groups, profiles, progress, workers."""
