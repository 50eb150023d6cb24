"""Export of a finished flight: one image, a TIFF with all bands, the canvas place of each pixel.

May import `views` for tiles with filled holes, `store`, `render`, `frames`, `stitch.camera` and `stitch.arrays`; called by `cli`.
"""
