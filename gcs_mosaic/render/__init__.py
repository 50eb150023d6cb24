"""Frames at their poses, painted on tiles. Pure: a tile is a function of the painted frames and their pictures.

May import `stitch.camera`, `stitch.transaction` and what a placement is; called by `app`, `export` and `baseline`.
`canvas` is the door, `repaint_queue` decides what is painted when.
"""
