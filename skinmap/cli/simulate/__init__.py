"""`skinmap simulate`: into recordings and as a live stream."""
