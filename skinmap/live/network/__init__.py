"""What travels between programs: messages, descriptions, addresses."""
