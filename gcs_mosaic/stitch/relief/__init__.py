"""Heights of the ground, and what they shift in each frame."""
