"""Export of a finished flight: one image, a TIFF with all bands, the canvas place of each pixel; files with coordinates, where
the map has an anchor.

May import `handover`, `geotiles`, `geo` and `notes` for the map on earth, `integral`, `views` for tiles with filled holes,
`store`, `render`, `frames`, `stitch.camera` and `stitch.arrays`; called by `cli`.
"""
