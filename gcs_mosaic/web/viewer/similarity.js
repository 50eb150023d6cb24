// @ts-check
// How a picture lies on a map: turned, scaled and shifted, never mirrored. Places of the canvas are [x, y] with y down, those of
// the map [east, north].

/**
 * The similarity of least squares over pairs of both; a single pair leaves turn and scale as they were `before`.
 * @param {number[][][]} pairs
 * @param {{ along: number, across: number }} before
 */
export function similarity(pairs, before = { along: 1, across: 0 }) {
  const [from, to] = [middle(pairs.map(([place]) => place)), middle(pairs.map(([, spot]) => spot))];
  let [size, along, across] = [0, 0, 0];
  for (const [[x, y], [east, north]] of pairs) {
    const [right, up, e, n] = [x - from[0], from[1] - y, east - to[0], north - to[1]];
    size += right ** 2 + up ** 2;
    along += right * e + up * n;
    across += right * n - up * e;
  }
  const turn = size > 0 ? { along: along / size, across: across / size } : before;
  return { ...turn, east: to[0] - turn.along * from[0] - turn.across * from[1], north: to[1] - turn.across * from[0] + turn.along * from[1] };
}

/**
 * Where a place of the canvas lies on the map.
 * @param {{ along: number, across: number, east: number, north: number }} laid
 * @param {number[]} place
 */
export function laidAt({ along, across, east, north }, [x, y]) {
  return [along * x + across * y + east, across * x - along * y + north];
}

function middle(points) {
  return [0, 1].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / points.length);
}
