"""A frame's way through the program, the same for all (`pipeline`), and how a flight is opened or gone on with."""
