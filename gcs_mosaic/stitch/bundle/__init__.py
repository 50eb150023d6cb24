"""Bundle adjustment of one island: poses, lenses and relief from all matches together, and how sure they are."""
