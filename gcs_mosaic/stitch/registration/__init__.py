"""Whether two frames show the same ground, how one lies on the other, and how good the evidence is."""
