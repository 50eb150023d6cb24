"""Ground that people point at: bound to a pixel of a frame, found again as the map moves."""
