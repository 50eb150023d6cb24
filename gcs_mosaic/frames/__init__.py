"""Where frames come from: a watched folder, files, a live stream (`rtsp`). Each comes once, and whole.

May import `messages`, `errors` and the types of pictures (`stitch.arrays`); called by `app`, and by `export` to decode originals.
"""
