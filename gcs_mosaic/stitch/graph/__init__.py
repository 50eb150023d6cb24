"""Frames and the links between them (a view graph, in the words of structure from motion), and with whom to compare a frame."""
