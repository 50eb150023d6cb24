"""From frames to one map, by their pixels alone.

`mosaic` is the door. In the order in which a frame meets them:

* `matching`: what is seen, and whether two frames show the same ground; `search` and `neighbours` choose with which frames.
* `geometry`: a camera over a plane; `projection`: the same for many points, with derivatives.
* `placing`: from links to a pose that can be believed; `waiting`, `islands`: what is done where that fails.
* `network`: all that is known of the frames, in one place.
* `adjusting`: all poses and lenses from all matches together, when, in which process, and how sure they are.
* `relief`: heights of the ground, and what they shift in each frame.
* `painting`: the picture.

Why it is done so, with sources: README, "The method".
"""
