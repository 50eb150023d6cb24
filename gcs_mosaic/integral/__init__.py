"""Through the trees: all looks at a place, laid together on a plane at a height, in focus there and blurred everywhere else.

Airborne optical sectioning: I. Kurmi, D. C. Schedl, O. Bimber, Journal of Imaging 4(8), 2018. Poses, lenses and relief are those
of the map; nothing else says where a camera was.

May import `views`, `store`, `render`, of `frames` the decoding, and `stitch.camera`; called by
`handover`, `export`, `web` and `cli`. What it can show, how to fly for it and its limits: README.md beside this file.
"""
