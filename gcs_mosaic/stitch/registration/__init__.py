"""Whether two frames overlap, the homography between them, and the strength of the evidence."""
