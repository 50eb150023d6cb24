"""Bundle adjustment of an island: poses, lenses and relief from all matches together, with their uncertainty.

Of the rooms outside of `stitch` it may import `processes`: `worker` adjusts large islands in a process of its own.
"""
