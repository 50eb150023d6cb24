"""Frames from a live video stream: received on a thread of its own, dated, and taken when a trigger asks for one."""
