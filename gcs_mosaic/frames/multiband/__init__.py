"""Bands of one shot that are files of their own (RedEdge, Altum, Sequoia, the Mavic 3M's) become one frame of several bands.

`shots` collects the files of each shot and decides, `rig` keeps how the lenses stand to each other, `registration` finds it by
pixels, `composition` makes the picture. What cannot be registered is never mixed: then one band is the frame, as without this.
The frame keeps the name of the file of its reference band, by which triggers and resumed flights know it.
"""
