"""Hints where people may look: what stands out, has a rare colour or moves, a colour that was picked, what a detector finds.

A hint is never a filter: nothing on the map is hidden, reordered or painted otherwise by it. Off by default. It is sought in a
process of its own beside the page, which reads the flight's ledger and originals and writes `hints.sqlite`; what was
dismissed is kept with the notes.

May import `processes`, `extensions`, `views`, `store`, `render`, `stitch.camera`, `stitch.arrays` and `errors`; called by
`web`, its settings also by `config` and `cli`.
"""
