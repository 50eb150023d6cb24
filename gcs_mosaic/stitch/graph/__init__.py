"""View graph: frames, the links between them, and the selection of match candidates."""
