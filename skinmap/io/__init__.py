"""Files in and out: taxel tables, URDF bodies, robot manifests."""
