"""Names for the shapes of arrays, for annotations. Type checkers only see the element type.

Canvas places and pixels are (x, y), x right, y down; NaN means "nowhere". Axis lengths: h, w of an image, the others any.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# General
Array = NDArray[np.float64]  # any shape
AnyArray = NDArray[Any]  # any shape and element type
Vector = NDArray[np.float64]  # (n,)
Vector32 = NDArray[np.float32]  # (n,)
Matrix = NDArray[np.float64]  # (n, m)
SquareMatrix = NDArray[np.float64]  # (n, n)
Matrices = NDArray[np.float64]  # (n, i, j), n small matrices
Matrix2x3 = NDArray[np.float64]  # an affine map target_from_source
Matrix3x3 = NDArray[np.float64]  # a homography target_from_source, or a rotation
RowsNx3 = NDArray[np.float64]  # (n, 3)
FloatRows = NDArray[np.float32]  # (n, k)

# Places
Vector2 = NDArray[np.float64]  # (2,), one point or shift, in pixels or canvas units
Rows2xN = NDArray[np.float64]  # (2, n): x and y of points
PointsNx2 = NDArray[np.float64]  # (n, 2) points or shifts, in pixels or canvas units
Points32Nx2 = NDArray[np.float32]  # (n, 2) pixels
AnyPointsNx2 = NDArray[Any]  # (n, 2) pixels, float32 or float64
PairPoints = NDArray[np.float64]  # (p, k, 2) pixels of up to k matches of p pairs of frames
PairValues = NDArray[np.float64]  # (p, k), one value per match
Box4 = NDArray[np.float64]  # (4,) left, top, right, bottom, canvas units
BoxesNx4 = NDArray[np.float64]  # (n, 4), as Box4
PosesNx6 = NDArray[np.float64]  # (n, 6) x, y, log_gsd, yaw, pitch, roll: canvas units and radians
LensesNx5 = NDArray[np.float64]  # (n, 5) log focal, k1, k2, shift_x, shift_y: half-diagonals
LensRowsNx6 = NDArray[np.float64]  # (n, 6) these, and 1 for a fisheye, else 0
ShiftGrid = NDArray[np.float64]  # (rows, columns, 2) shifts at the nodes of a grid over a frame

# Indices, masks, features
Indices = NDArray[np.intp]  # (n,)
IndexRows = NDArray[np.intp]  # (n, k)
IndexPairsNx2 = NDArray[np.intp]  # (n, 2), of matched features or linked frames
FeaturePairsNx2 = NDArray[np.uint16 | np.uint32]  # (n, 2) matched features, as stored
AnyPairsNx2 = NDArray[Any]  # (n, 2) integers of any type
Counts = NDArray[np.intp]  # (n,)
Mask = NDArray[np.bool_]  # any shape
Descriptors = NDArray[Any]  # (n, d), see `features.extraction.Features`

# Images, uint8 from 0, black, to 255, white, unless stated otherwise
ImageBGR = NDArray[np.uint8]  # (h, w, 3)
ImageBGRA = NDArray[np.uint8]  # (h, w, 4)
ImageGrey = NDArray[np.uint8]  # (h, w)
Coverage = NDArray[np.uint8]  # (h, w), 0 nothing seen, 255 fully covered
Planes = NDArray[np.uint8]  # (k, h, w)
PlaneStack = NDArray[np.uint8]  # (h, w, k)
Share = NDArray[np.uint8]  # (h, w), weight of one image in a mixture, 0 to 255
CellFlags = NDArray[np.uint8]  # (h, w), 0, PARTLY or WHOLLY of `render.cells`
LookupTable = NDArray[np.uint8]  # (256,)
Band = NDArray[Any]  # (h, w), any element type
Bands = NDArray[Any]  # (h, w, bands) uint8 or uint16; three bands are blue, green, red, others in file order
AnyImage = NDArray[Any]  # (h, w[, k]), any element type
Levels = NDArray[np.uint8] | NDArray[np.float32]  # (h, w, bands) in grey levels
FloatImage = NDArray[np.float32]  # (h, w[, k])
FloatPlanes = NDArray[np.float32]  # (k, h, w)
FaintImage = NDArray[np.int8]  # (h, w), see `features.faint.faint_picture`
Texture = NDArray[np.int8]  # (h, w), see `features.texture.texture`

# Tiles
Lattice = NDArray[np.float32]  # (rows, columns[, k]) values at lattice points or cells of tiles
FrameNumbers = NDArray[np.int32]  # (h, w), number of a frame per cell, or -1
ToneShifts = NDArray[np.int8]  # (3, h, w) shifts of blue, green and red, in 1 / `tone.FINE` grey levels
