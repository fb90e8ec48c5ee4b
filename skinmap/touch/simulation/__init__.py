"""Simulated touches: gestures, people, and how skin and sensors answer."""
