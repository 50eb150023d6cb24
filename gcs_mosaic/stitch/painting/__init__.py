"""Frames at their poses, painted on tiles."""
