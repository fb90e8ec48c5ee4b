"""The bare body: its links, their shading and their poses."""
