"""Contacts on a skin: how they are found, measured, followed in time and grouped into touches."""
