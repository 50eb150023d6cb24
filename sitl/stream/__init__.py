"""A streaming camera: feeds pictures to a real RTSP server on this host."""
