"""A flight's output folder: originals, ledger, tiles, documents, log. The contract with all who read it.

May import `messages`, `errors`, what is drawn (`render`) and what a placement is; called by `app`, `export`, `web` and `cli`.
"""
