"""What is drawn: the body, its skin, touches, the flat map, and the words beside them."""
