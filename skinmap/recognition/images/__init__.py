"""Classifiers of contact images: bags of visual words and a convolutional network."""
