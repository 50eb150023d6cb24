"""Camera model over a plane, relief displacement, and image bands and borders."""
