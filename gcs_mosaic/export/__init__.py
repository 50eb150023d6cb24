"""A finished flight for other programs: one picture, all bands in a TIFF, where each pixel lies.

May import `store`, `render`, `frames` and `stitch.camera`; called by `cli`, and by `web` for tiles whose holes are filled.
"""
