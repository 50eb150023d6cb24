"""Rendering: frames at their poses, painted on tiles. Pure: a tile is a function of the painted frames and their images.

May import `stitch.camera`, `stitch.transaction`, `stitch.arrays` and what a placement is; called by `app`, `export` and
`baseline`. The entry point is `compositor`; `repaint_queue` decides what is painted when.
"""
