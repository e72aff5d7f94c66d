// What is drawn in a frame, as annotations.json has it. Nothing here changes an entry: each function returns a new one.
import { area, contains, distance, distanceToOutline, edges, middle, nearestOn, pieces, same } from "./geometry.js";

/** px: an occlusion edge belongs to an outline that it is this close to. */
const SAME_LINE = 4;

export const nothing = () => ({ elements: [], occlusion_edges: [] });

/** Elements, then what is deliberately left blank, as if these were elements. */
export function shapes(entry) {
  const blank = (entry.blank ?? []).map((ring, k) => ({ id: `blank ${k + 1}`, label: "blank", polygons: [ring], visible: [] }));
  return [...entry.elements, ...blank];
}

function withShapes(entry, all) {
  const elements = all.filter((shape) => shape.label !== "blank");
  const blank = all.filter((shape) => shape.label === "blank").flatMap((shape) => shape.polygons);
  return { ...entry, elements, ...(blank.length || entry.blank ? { blank } : {}) };
}

export const replaceShape = (entry, index, ...by) => withShapes(entry, shapes(entry).flatMap((shape, k) => (k === index ? by : [shape])));
export const addShape = (entry, shape) => withShapes(entry, [...entry.elements, shape, ...shapes(entry).slice(entry.elements.length)]);

export function removeShape(entry, index) {
  const left = replaceShape(entry, index);
  const on = (line) => shapes(left).some((shape) => isOn(line, shape.polygons));
  return { ...left, occlusion_edges: left.occlusion_edges.filter(on) };
}

/** A name that no element has: the one wished for, or a number after it. */
export function freeId(entry, wish) {
  const taken = new Set(entry.elements.map((element) => element.id));
  if (!taken.has(wish)) return wish;
  const base = wish.replace(/_\d+$/, "");
  for (let number = 1; ; number += 1) if (!taken.has(`${base}_${number}`)) return `${base}_${number}`;
}

/** All points moved by a function, in outlines and occlusion edges: neighbours share corners. */
export function movePoints(entry, moved) {
  const all = shapes(entry).map((shape) => ({ ...shape, polygons: shape.polygons.map((ring) => ring.map(moved)) }));
  return { ...withShapes(entry, all), occlusion_edges: entry.occlusion_edges.map((line) => line.map(moved)) };
}

export function changeRing(entry, index, ring, change) {
  const shape = shapes(entry)[index];
  return replaceShape(entry, index, { ...shape, polygons: shape.polygons.map((points, k) => (k === ring ? change(points) : points)) });
}

export const insertVertex = (entry, index, ring, after, point) => changeRing(entry, index, ring, (points) => points.toSpliced(after + 1, 0, point));

/** Without a vertex; null when too few would be left. */
export function deleteVertex(entry, index, ring, vertex) {
  if (shapes(entry)[index].polygons[ring].length <= 3) return null;
  return changeRing(entry, index, ring, (points) => points.toSpliced(vertex, 1));
}

const isOn = (line, rings) => pieces(line).some(([a, b]) => distanceToOutline(middle(a, b), rings) < SAME_LINE);
const along = ([a, b]) => [0.25, 0.5, 0.75].map((share) => [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]);
const near = (p, [a, b]) => distance(p, nearestOn(p, a, b)) < SAME_LINE;

/** Whether an edge is marked as an occlusion edge, all along. */
export function isOccluded(entry, edge) {
  const marked = entry.occlusion_edges.flatMap(pieces);
  return along(edge).every((p) => marked.some((piece) => near(p, piece)));
}

export function toggleOcclusion(entry, edge) {
  if (!isOccluded(entry, edge)) return { ...entry, occlusion_edges: [...entry.occlusion_edges, edge] };
  const left = entry.occlusion_edges.flatMap((line) => {
    const kept = pieces(line).filter(([a, b]) => !near(middle(a, b), edge));
    return kept.length === line.length - 1 ? [line] : kept;
  });
  return { ...entry, occlusion_edges: left };
}

/** A proposed element as drawn, with those of the proposed occlusion edges that run along it. */
export function confirm(entry, { edges: _edges, score: _score, ...element }, occlusionEdges) {
  const drawn = addShape(entry, { ...element, id: freeId(entry, element.id) });
  const own = occlusionEdges.filter((line) => isOn(line, element.polygons) && !pieces(line).every((piece) => isOccluded(entry, piece)));
  return { ...drawn, occlusion_edges: [...drawn.occlusion_edges, ...own] };
}

/** A proposed element as it was before it was moved to lines of the image. */
export function unsnapped(element) {
  const all = element.edges;
  let first = 0;
  const polygons = element.polygons.map((ring) => {
    const own = all.slice(first, first + ring.length);
    first += ring.length;
    const before = (k) => own[(k + ring.length - 1) % ring.length]?.unsnapped;
    return ring.map((point, k) => own[k]?.unsnapped?.[0] ?? before(k)?.[1] ?? point);
  });
  return { ...element, polygons, edges: all.map((edge) => ({ ...edge, unsnapped: null })) };
}

/** Lines that ran along the outline of a proposed element, moved to where it is now; both have the same corners. */
export function movedAlong(lines, before, now) {
  const sides = before.polygons.flatMap((ring, r) => edges(ring).map((edge, k) => [edge, edges(now.polygons[r])[k]]));
  const moved = (p) => {
    const [side] = sides.filter(([edge]) => near(p, edge)).sort(([a], [b]) => distance(p, nearestOn(p, ...a)) - distance(p, nearestOn(p, ...b)));
    if (!side) return p;
    const [[a, b], [c, d]] = side;
    const share = distance(a, nearestOn(p, a, b)) / Math.max(distance(a, b), 1e-9);
    return [c[0] + share * (d[0] - c[0]), c[1] + share * (d[1] - c[1])];
  };
  return lines.map((line) => (isOn(line, before.polygons) ? line.map(moved) : line));
}

/** The smallest shape at a point, -1 for none: doors and windows lie on their walls. */
export function shapeAt(all, point) {
  const at = all.map((shape, k) => [k, shape]).filter(([, shape]) => shape.polygons.some((ring) => contains(ring, point)));
  const size = ([, shape]) => shape.polygons.reduce((sum, ring) => sum + area(ring), 0);
  return at.sort((a, b) => size(a) - size(b))[0]?.[0] ?? -1;
}

/** All corners and edges that can be snapped to, without those at the points that are being moved. */
export function snapTargets(all, moving) {
  const rings = all.flatMap((shape) => shape.polygons);
  const stays = (point) => !moving.some((one) => same(one, point));
  return { corners: rings.flat().filter(stays), edges: rings.flatMap(edges).filter(([a, b]) => stays(a) && stays(b)) };
}
