"""Frame sources: a watched folder, files, a live stream (`rtsp`). Each frame is delivered once, and complete.

May import `messages`, `errors` and `stitch.arrays`; used by `app`, and by `export` to decode originals.
"""
