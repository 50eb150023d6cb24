"""Features of a frame, their matching, image sharpness and image retrieval."""
