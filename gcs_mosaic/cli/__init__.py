"""The command line: words become settings, and a run of `app`.

May import `app`, `config` and what its own commands show of other rooms; called by `gcs_mosaic.__main__` alone.
"""
