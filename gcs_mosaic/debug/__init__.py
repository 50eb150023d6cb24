"""Pictures of what was decided and why (`stitch --debug`): matches, refusals, footprints, residuals, relief.

May import `stitch`, whose decisions it observes; called by `app.batch`.
"""
