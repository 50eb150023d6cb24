"""The finished map on earth: tiles of Web Mercator (XYZ), north up, for other programs' maps.

A tile is a pure function of the islands' anchors and the canvas' tiles. Everything that shows or exports the map on earth reads
the one pyramid that is here; nothing of it goes back to where frames are placed or how they look.

May import `geo`, `views` for tiles with filled holes, `render` for the grid of tiles, `stitch.arrays`, `store` and `errors`;
called by `web`, `export` and `cli`.
"""
