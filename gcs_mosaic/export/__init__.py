"""Export of a finished flight: one image, a TIFF with all bands, the canvas place of each pixel.

May import `store`, `render`, `frames`, `stitch.camera` and `stitch.arrays`; called by `cli`, and by `web` for tiles with filled
holes.
"""
