// Changes of shapes that the server computes: a cut, a stroke of the brush, and visible parts from texture and tracks.
import { post } from "./api.js";
import * as entries from "./entry.js";

/** Where an element is now: it may have been drawn on since something was asked of the server. */
function indexOf(entry, id) {
  const index = entry.elements.findIndex((element) => element.id === id);
  if (index < 0) throw new Error(`${id} is no longer there.`);
  return index;
}

export const cut = (app, id, line) =>
  app.changing(async () => {
    const { polygons } = app.drawing.entry.elements[indexOf(app.drawing.entry, id)];
    const { parts } = await post("shape", { op: "split", polygons, line });
    const { entry } = app.drawing;
    const index = indexOf(entry, id);
    const [larger, smaller] = parts.map((part) => ({ ...entry.elements[index], polygons: part, visible: [] }));
    app.drawing.change(entries.replaceShape(entry, index, larger, { ...smaller, id: entries.freeId(entry, id) }));
  });

/** @param op "paint" or "erase" */
export const paint = (app, id, op, stroke, radius) =>
  app.changing(async () => {
    const { visible, polygons: within } = app.drawing.entry.elements[indexOf(app.drawing.entry, id)];
    // Erasing begins with all of it: nothing drawn means that all is visible.
    const polygons = visible?.length ? visible : op === "erase" ? within : [];
    const made = await post("shape", { op, polygons, stroke, radius, within });
    setVisible(app, new Map([[id, made.polygons]]));
  });

/** Propose visible parts of elements. */
export const texture = (app, ids) =>
  app.changing(async () => {
    const openings = app.about.labels.filter((label) => label.opening).map((label) => label.name);
    const proposed = new Map();
    for (const id of ids) {
      const { elements } = app.drawing.entry;
      const { label, polygons } = elements[indexOf(app.drawing.entry, id)];
      const before = openings.includes(label) ? [] : elements.filter((one) => openings.includes(one.label)).flatMap((one) => one.polygons);
      proposed.set(id, (await post("shape", { op: "texture", frame: app.frame, polygons, before })).polygons);
    }
    setVisible(app, proposed);
    app.say(`Visible parts proposed for ${ids.length} element${ids.length === 1 ? "" : "s"}: paint (B) and erase (E) correct them.`);
  });

/** Visible parts by the elements' ids, all as one change. */
function setVisible(app, visible) {
  const { entry } = app.drawing;
  const elements = entry.elements.map((element) => (visible.has(element.id) ? { ...element, visible: visible.get(element.id) } : element));
  app.drawing.change({ ...entry, elements });
}
