"""Live mosaics from camera triggers, stitched from the images alone."""
