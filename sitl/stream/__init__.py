"""A camera that streams: pictures go into a real RTSP server on this host."""
