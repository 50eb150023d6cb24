"""The page: a flight's output folder, read-only, over HTTP, with news of tiles as they are painted.

May import `store` and `export` for reading; called by `app` and `cli`.
"""
