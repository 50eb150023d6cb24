"""Baseline: the paper's method, implemented literally for comparison (`--method paper`).

Portakal, Kındıroğlu, Uluyağmur Öztürk, "Real Time Incremental Image Mosaicking Without Use of Any Camera Parameter". One file
per step, to be read alongside its section III: `features` (A, of the frame and the region of interest), `matching` (B),
`homography` (C), `blending` (D); `raster` is the growing mosaic, `mosaic` the entry point.

The only additions bound its memory when it fails: a frame is refused, with a reason, if it would lie beyond its own horizon, be
mirrored, be implausibly large, or make the mosaic exceed its limit.
"""
