"""Is a recording sound: faults of its times, channels, rest and labels, found without a model.

`skinmap.examine` reads anyone's recording and lists findings. Each family of faults has a module;
all of them look at the same `Survey`, which is made in one pass over the samples.
"""
