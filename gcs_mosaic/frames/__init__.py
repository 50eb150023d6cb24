"""Frame sources: a watched folder, files, a live stream (`rtsp`). Each frame is delivered once, and complete.

May import `messages` and `errors`; used by `app`, and by `export` to decode originals.
"""
