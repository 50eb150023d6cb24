"""Programs that end by themselves: stitch, replay, merge, pair, benchmark."""
