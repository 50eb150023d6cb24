"""Would a person have been seen? The probability that pictures show one of given size and clothes so that a reader finds it.

It advises where to look or fly again; it clears no ground. Off until somebody asks: then the originals are measured, one after
the other, beside the flight. What is meant by probability of detection: B. O. Koopman, "Search and Screening", OEG Report 56,
1946 (there an independent chance at each look); that looks are not independent: A. R. Washburn, "Search and Detection", 2014.

May import `views`, `store`, `render`, `stitch.arrays`, `stitch.camera` and `errors`; called by `handover`, `export` and `web`,
its words also by `cli`.
"""
