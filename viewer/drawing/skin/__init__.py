"""The skin: its sheets, taxels and colours."""
