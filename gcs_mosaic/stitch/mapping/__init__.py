"""Incremental mapping: frames are placed one by one, on islands that may be merged later."""
