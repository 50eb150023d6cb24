"""What a frame shows, and whether two frames show the same ground."""
