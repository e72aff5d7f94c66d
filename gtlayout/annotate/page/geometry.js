// Points are [x, y] in pixels of the image.

export const distance = ([ax, ay], [bx, by]) => Math.hypot(ax - bx, ay - by);
export const middle = ([ax, ay], [bx, by]) => [(ax + bx) / 2, (ay + by) / 2];
export const same = (a, b) => distance(a, b) < 0.5;
export const rounded = ([x, y]) => [Math.round(x * 100) / 100, Math.round(y * 100) / 100];

/** The point of the line from a to b that is nearest to p. */
export function nearestOn(p, a, b) {
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
  const share = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / Math.max(dx * dx + dy * dy, 1e-12);
  const inside = Math.min(Math.max(share, 0), 1);
  return [a[0] + inside * dx, a[1] + inside * dy];
}

export const edges = (ring) => ring.map((point, k) => [point, ring[(k + 1) % ring.length]]);
export const pieces = (line) => line.slice(1).map((point, k) => [line[k], point]);

export function area(ring) {
  return Math.abs(edges(ring).reduce((sum, [a, b]) => sum + a[0] * b[1] - a[1] * b[0], 0)) / 2;
}

export function contains(ring, [x, y]) {
  return edges(ring).filter(([[ax, ay], [bx, by]]) => ay > y !== by > y && x < ax + ((y - ay) / (by - ay)) * (bx - ax)).length % 2 === 1;
}

export const distanceToOutline = (p, rings) =>
  Math.min(Infinity, ...rings.flatMap(edges).map(([a, b]) => distance(p, nearestOn(p, a, b))));
