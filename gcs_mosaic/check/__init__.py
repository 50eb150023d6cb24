"""Checks a flight's folder against itself, and makes anew what ledger and originals can give.

May import `notes` (its tables), `store`, `render`, `frames`, the placement types and `errors`; called by `cli` alone.
"""
