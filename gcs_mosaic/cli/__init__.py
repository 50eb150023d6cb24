"""The command line: turns arguments into settings and runs `app`.

May import `app`, `config` and what its own commands need of other rooms; called by `gcs_mosaic.__main__` alone.
"""
