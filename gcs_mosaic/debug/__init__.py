"""Debug pictures of decisions (`stitch --debug`): matches, refusals, footprints, residuals, relief.

May import `stitch`, which it observes; called by `app.commands.batch`.
"""
