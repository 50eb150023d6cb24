"""Where a finished map lies on earth, for showing only.

An anchor gives an island of the map longitude and latitude, with its error said. It comes from pins that people set, or from
the positions in the triggers if that was asked for. Nothing of this may ever influence where a frame is placed or how it looks:
neither `stitch` nor `render` imports this room, and this room imports neither.

May import `errors`; called by `notes`, `web`, `export` and `cli`.
"""
