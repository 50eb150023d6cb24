// @ts-check
// Where a frame lies on the canvas.

/** The frame's corners on the canvas as [y, x]; null if one of them sees no ground. @returns {any} */
export function outlineOf({ canvas_from_frame: h, width, height }) {
  const corners = [[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]];
  const weights = corners.map(([x, y]) => h[2][0] * x + h[2][1] * y + h[2][2]);
  if (weights.some((w) => w * weights[0] <= 0)) return null;
  return corners.map(([x, y], i) => [1, 0].map((row) => (h[row][0] * x + h[row][1] * y + h[row][2]) / weights[i]));
}

/** The middle of a frame's outline, [y, x]; null where it reaches beyond the horizon. @returns {any} */
export function middleOf(frame) {
  const corners = outlineOf(frame);
  return corners && [0, 1].map((axis) => corners.reduce((sum, corner) => sum + corner[axis], 0) / corners.length);
}

/** Yellow (or the colour of one of several aircraft) on black, so that it shows on any ground. */
export function outlineLayer(corners, colour) {
  const line = (color, weight) => L.polygon(corners, { color, weight, fill: false, interactive: false });
  return L.featureGroup([line("#000", 6), line(colour, 3)]);
}
