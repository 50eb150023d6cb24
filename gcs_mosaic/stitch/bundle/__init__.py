"""Bundle adjustment of an island: poses, lenses and relief from all matches together, with their uncertainty."""
