"""A flight's output folder: originals, ledger, tiles, documents, log. The interface for all readers.

May import `messages`, `errors`, `render` and the placement types; used by `app`, `export`, `web` and `cli`.
"""
