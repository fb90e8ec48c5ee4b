"""Contacts of a sample, contacts through time, and the touches they make up."""
