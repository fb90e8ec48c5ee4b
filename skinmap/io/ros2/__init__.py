"""ROS 2's messages without ROS 2: definitions, CDR, bags, and a robot's skin as its topics."""
