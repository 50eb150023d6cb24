"""Simulated flights with ground truth: synthetic ground, a camera, a MAVLink vehicle, and a score.

A measuring instrument for gcs-mosaic, and therefore without any code in common.
"""
