"""Applications: a live flight, a folder of frames, a recorded flight. All of them drive one `pipeline`.

From the ground up, each folder knowing those above it in this list, but that `live` and `commands` know nothing of each other:

| folder | holds |
|---|---|
| `waiting/` | frames that wait: in what order, prepared ahead, tried again |
| `pipeline/` | a frame's way through the program, and the opening of a flight |
| `inputs/` | links, frame sources, camera events |
| `status/` | what is told: terminal, status.json, flight.log, ground station, service manager |
| `live/` | a live flight: `daemon` is its main loop |
| `commands/` | programs that end by themselves: stitch, replay, merge, pair, benchmark |

May import every package but `cli`; used by `cli` alone. Threads and processes, and what each owns:

| name | started by | owns |
|---|---|---|
| main thread | the operating system | the ledger, the mosaic, the canvas, the documents; no other thread writes to them |
| `link …`, `frames` | `inputs.inbox` | a link, or the frame source, whose originals it keeps; a queue leads to the main thread |
| process `stream` | `frames.rtsp.keeper`, with a live stream | the camera connection and the ring buffer of newest images |
| process `video` | `frames.video.reading`, while a recorded video is read | the open video and its newest pictures |
| `prepare` (pool of 2) | `waiting.prefetch` | nothing: has a file's bytes turned into pixels, and those into features |
| process `decode` (2 at most) | `frames.decoding`, when frames are prepared | one file and its picture, until it is sent |
| `register` (pool of 2) | `stitch.graph.candidates` | nothing: registers one pair of frames per task |
| `paint` (pool of 2) | `render.compositor` | nothing: cells and pixels of tiles, one task each |
| `tiles` (pool of 2) | `store.tiles` | the tile files being encoded and written |
| `durability` | `store.durability` | nothing: syncs the ledger to disk |
| `checkpoint` | `store.checkpoint` | the checkpoint files while one is written |
| `progress`, `progress lines` | a command that ends by itself | `progress.json`; lines where nobody sits at a terminal |
| `page` | `web.page_keeper` | the pipe to the page's process, and the changes that it has not been told of yet |
| process of the page | `web.page_keeper` | the open pages; reads tiles and documents, writes nothing |
| in it `web`, `web tiles` (pool of 2) | `web.server` | connections and requests; tiles being filled |
| in it `hints`, process `hints` | `web.hint_keeper`, while somebody wants hints | `hints.sqlite`; reads ledger and originals |
| process `adjust`, thread `adjust` | `stitch.bundle.worker` | a copy of one island's problem, until the result is sent |

Each process has a thread in the program that logs what it prints. Objects passed between them are never changed afterwards.
Processes end with the program, however it ends. One that dies is started again at once, and more slowly if it dies again
(`processes.keeper`): `stream`, the page and `hints` by themselves, `decode` for the next picture, `adjust` for the next
adjustment, some frames later.
"""
