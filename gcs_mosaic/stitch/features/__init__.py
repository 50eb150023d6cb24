"""What is seen in a frame: features, how sharp it is, what is alike in two frames and which frames are alike."""
