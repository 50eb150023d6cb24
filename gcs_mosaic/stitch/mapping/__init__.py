"""Frames find their place one by one, on islands that may join later."""
