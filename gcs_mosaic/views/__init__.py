"""What can be asked of a flight: answers made of its ledger, originals and tiles, which are only read.

May import `store`, `render`, of `frames` the decoding, and `stitch.camera`; called by `notes`, `geotiles` and `export`, and by
`web`, which runs it on threads of the page's process, beside the flight and never in it.
"""
