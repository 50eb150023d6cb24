"""Frames from a live video stream: received on its own thread, timestamped, and selected on triggers."""
