


May import `geotiles`, `geo` and `notes` for the map on earth, `views` for tiles with filled holes, `store`, `render`, `frames`,
`stitch.camera` and `stitch.arrays`; called by `cli`.
"""
