"""The map on earth for other programs, under /maps/: XYZ, WMS, WMTS, and what ATAK, Google Earth and QGIS open.

Each module speaks one protocol; all of them show the one `served_map`. A program that cannot keep a cookie has the token in its
address (`access`). What they read changes nothing.
"""
