"""What runs: a live flight, a folder of frames, a recorded flight. All of them drive one `pipeline`.

May import every room but `cli`; called by `cli` alone. Threads and processes, with who owns what:

| name | started by | owns |
|---|---|---|
| main thread | the operating system | the ledger, the mosaic, the canvas, the documents; nobody else writes to them |
| `link …`, `frames` | `inbox` | one link, or the source of frames, whose originals it keeps; one queue leads to the main thread |
| `stream` | `frames.rtsp.receiver` | the camera's connection and the ring of its newest pictures |
| `prepare` (pool of 2) | `prefetch` | nothing: a file's bytes become pixels and features |
| `register` (pool of 2) | `stitch.graph.candidates` | nothing: a pair of frames is compared by each |
| `paint` (pool of 2) | `render.canvas` | nothing: cells and pixels of tiles, each by one of them |
| `tiles` (pool of 2) | `store.tiles` | the tile files that are being encoded and written |
| `durability` | `store.durability` | nothing: brings to the disk what the ledger has been told |
| `checkpoint` | `store.checkpoint` | the files of the checkpoint, while one is written |
| `web`, `web tiles` (pool of 2) | `web.server` | the open pages; reads tiles and documents, writes nothing |
| process `adjust`, thread `adjust` | `stitch.bundle.worker` | a copy of one island's problem, until the answer is sent |

What one of them hands to another never changes afterwards.
"""
