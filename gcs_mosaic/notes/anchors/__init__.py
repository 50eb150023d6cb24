"""What lays a map on earth: pins, known distances, control points, and the anchors fitted to them."""
