"""The page: serves a flight's output folder read-only over HTTP, and pushes tile updates as they are painted.

May import `store` and `export` for reading; called by `app` and `cli`.
"""
