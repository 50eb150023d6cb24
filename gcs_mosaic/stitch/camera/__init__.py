"""A camera over a plane, what relief shifts in its pictures, and the pictures themselves."""
