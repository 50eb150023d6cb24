"""Frames in, one map out, from pixels alone. The entry point is `mosaic`.

Pure: no clock, no files but a model's, no threads except the one in `bundle.worker`. Its rooms; each may import only those
before it:

* `arrays`: names for the shapes of arrays, for annotations.
* `camera`: a camera over a plane with analytic derivatives; relief displacement; a frame's bands and dead border.
* `features`: feature extraction, matching and image retrieval.
* `registration`: whether two frames overlap, the homography between them, and the evidence for it.
* `graph`: the state of all frames and links in one place; selection of match candidates.
* `bundle`: bundle adjustment of poses and lenses: scheduling, worker process, uncertainty; relief.
* `mapping`: from links to accepted poses; waiting frames; islands and how they are merged.

Reasons and sources: gcs_mosaic/README.md, "The method".
"""
