"""Frames from recorded videos, chosen as from a live stream (`rtsp`), but every one of them comes.

A video is read by a process of its own (`process`), which `reading` starts, bounds and starts again; what comes out of it is a
JPEG for each frame and what the recording says of its place and time, for showing and for anchors alone. What loads PyAV is
loaded in that process alone.
"""
