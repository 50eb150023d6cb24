"""From frames to one map, by their pixels alone.

In the order in which a frame meets them:

* What is seen: `features`, `matching`, `evidence`, `registration`; `retrieval` and `search` choose with which frames.
* Where it lies: `geometry` (a camera over a plane), `placing`, `network` (all that is known), `islands`, `mosaic` (the door).
* Together: `problem`, `residuals`, `parallax`, `adjustment`, `solving`; `upkeep` and `background` say when, and in which
  process; `deviation`, `covariance`, `certainty` how sure.
* Below the plane: `ground` (points that several frames have seen), `relieving`, `relief`.
* The picture: `grid`, `lattice`, `warping`, `view`, `exposure`, `blending`, `layers`, `stack`, `overviews`, `painted`,
  `canvas`.

Why it is done so, with sources: README, "The method".
"""
