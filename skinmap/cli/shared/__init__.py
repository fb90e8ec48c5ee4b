"""What commands share: options, groups, interrupts, profiles, workers."""
