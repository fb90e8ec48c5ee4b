"""The viewer: skins, pressures and named touches on the robot's body."""
