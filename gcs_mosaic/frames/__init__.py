"""Frame sources: a watched folder, files, a live stream (`rtsp`). Each frame is delivered once, and complete; bands in files of
their own become one (`multiband`).

Their pictures are decoded in processes of their own (`decoding`).

May import `processes`, `even_clock`, `messages`, `errors` and `stitch.arrays`; used by `app`, and by `export` for originals.
"""
