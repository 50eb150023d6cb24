"""The page: serves a flight's output folder read-only over HTTP, and pushes tile updates as they are painted. What people add to
the flight it keeps in a file of their own.

May import `handover`, `notes`, `hints`, `views`, `geo`, `geotiles` and `store` for reading, of `frames` the decoding,
`render` for the grid of tiles, `processes`, `stitch.arrays` and `messages`; called by `app` and `cli`, its settings also by
`config`. During a live flight all but `page_keeper` and what it needs runs in a process of its own (`page_process`).
"""

import os

# aiohttp reads it on import. With sendfile a connection that is cut while it sends leaves asyncio's selector (Python 3.11) with a
# file that is closed, and no further connection is served.
os.environ.setdefault("AIOHTTP_NOSENDFILE", "1")
