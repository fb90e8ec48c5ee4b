from skinmap.commands.options import open_robot, prints

__all__ = [
    "open_robot",
    "prints",
]
