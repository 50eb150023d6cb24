"""All poses and lenses of an island from all matches together, and how sure they are."""
