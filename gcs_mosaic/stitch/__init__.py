"""From frames to one map, by their pixels alone. `mosaic` is the door.

Pure: no clock, no file, no thread but the one in `bundle.worker`. Its rooms, each of which may import only those before it:

* `camera`: a camera over a plane, with derivatives; what relief shifts; a frame's bands and dead border.
* `features`: what is seen in a frame, and what is alike in two.
* `registration`: whether two frames show the same ground, and how one lies on the other.
* `graph`: all that is known of frames and links, in one place; with whom a frame is compared.
* `bundle`: all poses and lenses from all matches together: when, in which process, and how sure they are; heights.
* `mapping`: from links to a pose that can be believed; what waits, islands and how they join.

Why it is done so, with sources: gcs_mosaic/README.md, "The method".
"""
