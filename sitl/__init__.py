"""A simulated flight with known truth: made-up ground, a camera, a vehicle that speaks MAVLink, and a score.

It is an instrument for measuring gcs-mosaic and therefore shares no code with it.
"""
