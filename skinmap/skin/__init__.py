"""What a skin is: taxel table, robot and links, repair of normals."""
