"""Publishers of samples, contacts and labels."""
