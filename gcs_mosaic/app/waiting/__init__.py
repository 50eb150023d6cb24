"""Frames that wait: prepared ahead, in turn, and tried again when they could not be read."""
