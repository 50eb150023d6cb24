"""The paper's recipe, literally: what the rest of this program is measured against (`--method paper`).

Portakal, Kındıroğlu, Uluyağmur Öztürk, "Real Time Incremental Image Mosaicking Without Use of Any Camera Parameter". One file
for each step, to be read beside its section III: `features` (A, on the frame and on the region of interest), `matching` (B),
`homography` (C), `blending` (D); `raster` is the mosaic that grows, `mosaic` the door.

Added is only what keeps it from taking all memory when it fails: a frame is refused, with a reason, that would lie beyond its
own horizon, mirrored, or larger than is believed, or with which the mosaic would outgrow its bound.
"""
