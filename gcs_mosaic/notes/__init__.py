"""What people add to a flight: finds, a scale, pins, what was reviewed, hints that were dismissed; and its exports.

They lie in a file of their own, `notes.sqlite`, written by whoever serves the page: the flight's ledger has one writer, and
nothing that people do on the page may lock, slow or damage it.

From the ground up: `storage/` the file, `ground/` bound places, `anchors/` pins and known distances, `finds/` markers and their
reports, `search/` what was looked at and which hints; `merged_notes` takes those of several flights over to one map.

May import `store`, `views`, `geo`, `render`, `frames`, `stitch.camera`, `stitch.arrays`, `messages` and `errors`; called by
`web`, `check` and `cli`.
"""
