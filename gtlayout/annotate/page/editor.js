// What clicks, drags and keys do to the drawing: the tools.
import { cut, paint } from "./brush.js";
import * as entries from "./entry.js";
import { distance, edges, middle, nearestOn, rounded, same } from "./geometry.js";

/** px of the window within which something is meant; fingers are less exact. */
const REACH = { mouse: 9, pen: 10, touch: 18, key: 12 };
const SNAP_CORNER = 9;
const SNAP_EDGE = 6;

export class Editor {
  /** @param app has drawing, drafts, proposal, frame, stage, redraw(), say(text) */
  constructor(app) {
    Object.assign(this, { app, tool: "select", label: "wall", selected: null, pen: [], cursor: null, isPointed: false, snapping: true, brush: 20, held: null });
  }

  get entry() {
    return this.held?.now ?? this.app.drawing.entry;
  }

  get shapes() {
    return entries.shapes(this.entry);
  }

  reset() {
    Object.assign(this, { tool: "select", selected: null, pen: [], held: null });
  }

  setTool(tool, label = this.label) {
    const needs = { split: "split", paint: "paint", erase: "erase from" }[tool];
    if (needs && this.selected?.kind !== "shape") return this.app.say(`Select the element to ${needs} first.`);
    Object.assign(this, { tool, label, pen: [], held: null });
    if (tool === "draw") this.selected = null;
    this.app.say(HINTS[tool]?.(label) ?? "");
    return this.app.redraw();
  }

  select(selected) {
    this.selected = selected;
    const one = selected && (selected.kind === "shape" ? this.shapes : this.app.drafts)[selected.index];
    if (one) this.app.say(`${one.id}: ${selected.kind === "draft" ? "proposed. Enter confirms it, Del dismisses it, a drag corrects it." : `${one.label}. Drag corners and edges; a click on an edge marks an occlusion edge.`}`);
    this.app.redraw();
  }

  // Snapping

  snap(point, moving = [], event = {}) {
    const inside = this.app.stage.inside(point);
    if (!this.snapping || event.altKey) return rounded(inside);
    const { scale } = this.app.stage.view;
    const [width, height] = this.app.stage.size;
    const image = { polygons: [[[0, 0], [width, 0], [width, height], [0, height]]] };
    const targets = entries.snapTargets([...this.shapes, ...this.app.drafts, image], moving);
    const nearest = (points, reach) => {
      const best = points.map((p) => [distance(p, point), p]).sort((a, b) => a[0] - b[0])[0];
      return best && best[0] * scale <= reach ? best[1] : null;
    };
    const corner = nearest([...targets.corners, ...this.pen], SNAP_CORNER);
    return rounded(corner ?? nearest(targets.edges.map(([a, b]) => nearestOn(point, a, b)), SNAP_EDGE) ?? inside);
  }

  /** What of the selected shape lies at a point: a corner, the handle of a new one, or an edge. */
  partAt(point, event) {
    const shape = this.selected && (this.selected.kind === "shape" ? this.shapes : this.app.drafts)[this.selected.index];
    const reach = (REACH[event.pointerType] ?? REACH.key) / this.app.stage.view.scale;
    const found = (shape?.polygons ?? []).flatMap((ring, r) => [
      ...ring.map((corner, k) => ({ kind: "corner", ring: r, k, off: distance(corner, point) - reach / 2 })),
      ...edges(ring).map(([a, b], k) => ({ kind: "new", ring: r, k, off: distance(middle(a, b), point) - reach / 4 })),
      ...edges(ring).map(([a, b], k) => ({ kind: "edge", ring: r, k, off: distance(nearestOn(point, a, b), point) })),
    ]);
    const best = found.filter((part) => part.off <= (part.kind === "corner" ? reach / 2 : part.kind === "new" ? reach / 4 : reach * 0.7));
    return best.sort((a, b) => a.off - b.off)[0] ?? null;
  }

  // Pointers

  hover(point) {
    this.isPointed = true; // the cross is not that of the keyboard
    if (this.tool === "select") {
      if (this.cursor) {
        this.cursor = null; // that of the keyboard
        this.app.redraw();
      }
      return;
    }
    this.cursor = this.tool === "draw" ? this.snap(point) : this.app.stage.inside(point);
    this.app.redraw();
  }

  click(point, event) {
    if (this.tool === "draw") return this.addPoint(this.snap(point, [], event), event);
    if (this.tool === "split") return this.splitAt(this.snap(point, [], event));
    if (this.tool === "paint" || this.tool === "erase") return this.stroke([point]);
    const part = this.partAt(point, event);
    if (part?.kind === "corner") return this.select({ ...this.selected, ring: part.ring, vertex: part.k });
    if (part && this.selected.kind === "shape") {
      const edge = edges(this.shapes[this.selected.index].polygons[part.ring])[part.k];
      this.app.drawing.change(entries.toggleOcclusion(this.entry, edge));
      this.app.say(entries.isOccluded(this.entry, edge) ? "Occlusion edge: the two sides do not touch there." : "Contact edge: the two sides touch there.");
      return this.app.redraw();
    }
    const shape = entries.shapeAt(this.shapes, point);
    if (shape >= 0) return this.select({ kind: "shape", index: shape });
    const draft = entries.shapeAt(this.app.drafts, point);
    return this.select(draft >= 0 ? { kind: "draft", index: draft } : null);
  }

  grab(point, event) {
    if (this.tool === "paint" || this.tool === "erase") {
      this.pen = [point];
      return true;
    }
    const part = this.tool === "select" ? this.partAt(point, event) : null;
    if (!part) return false;
    if (this.selected.kind === "draft") this.confirm();
    let entry = this.entry;
    const { index } = this.selected;
    const ring = entries.shapes(entry)[index].polygons[part.ring];
    if (part.kind === "new") entry = entries.insertVertex(entry, index, part.ring, part.k, middle(...edges(ring)[part.k]));
    const corners = entries.shapes(entry)[index].polygons[part.ring];
    const k = part.kind === "new" ? part.k + 1 : part.k;
    const moving = part.kind === "edge" ? edges(corners)[k] : [corners[k]];
    this.selected = { kind: "shape", index, ring: part.ring, ...(part.kind === "edge" ? {} : { vertex: k }) };
    this.held = { entry, now: entry, moving, from: point, alone: event.altKey };
    return true;
  }

  drag(point, event) {
    if (this.held) this.held.now = this.moved(point, event);
    else this.pen = [...this.pen, point];
    this.cursor = this.held ? null : point;
    this.app.redraw();
  }

  drop(point, event) {
    if (!this.held) return this.stroke(this.pen);
    const after = this.moved(point, event);
    this.held = null;
    this.app.drawing.change(after);
    return this.app.redraw();
  }

  cancel() {
    Object.assign(this, { held: null, pen: [] });
    this.app.redraw();
  }

  /** The drawing with the held points moved; corners that others share with them go along, unless Alt is held. */
  moved(point, event) {
    const { entry, moving, from, alone } = this.held;
    const by = [point[0] - from[0], point[1] - from[1]];
    const free = moving.map(([x, y]) => [x + by[0], y + by[1]]);
    const to = moving.length === 1 ? [this.snap(free[0], moving, event)] : free.map((p) => rounded(this.app.stage.inside(p)));
    const follow = (p) => to[moving.findIndex((one) => same(one, p))] ?? p;
    return alone ? entries.changeRing(entry, this.selected.index, this.selected.ring, (ring) => ring.map(follow)) : entries.movePoints(entry, follow);
  }

  // Drawing

  addPoint(point, event = {}) {
    const reach = (REACH[event.pointerType] ?? REACH.key) / this.app.stage.view.scale;
    if (this.pen.length >= 3 && distance(point, this.pen[0]) <= reach) return this.finish();
    if (this.pen.length && same(point, this.pen.at(-1))) return undefined;
    this.pen = [...this.pen, point];
    return this.app.redraw();
  }

  finish() {
    if (this.pen.length < 3) return this.app.say("An element needs three corners at least.");
    const id = entries.freeId(this.entry, `${this.label}_1`);
    const shape = { id, label: this.label, polygons: [this.pen], visible: [] };
    this.app.drawing.change(entries.addShape(this.entry, shape));
    const index = this.shapes.findIndex((one) => one.polygons[0] === this.pen);
    Object.assign(this, { pen: [], tool: "select" });
    return this.select({ kind: "shape", index });
  }

  relabel(label) {
    const shape = this.selected?.kind === "shape" ? this.shapes[this.selected.index] : null;
    if (!shape || shape.label === "blank") return this.app.say("Select the element to relabel first.");
    const own = shape.id === shape.label || /_\d+$/.test(shape.id);
    const id = own ? entries.freeId(this.entry, `${label}_1`) : shape.id;
    this.app.drawing.change(entries.replaceShape(this.entry, this.selected.index, { ...shape, label, id }));
    return this.select(this.selected);
  }

  remove() {
    if (!this.selected) return undefined;
    const { kind, index, ring, vertex } = this.selected;
    if (kind === "draft") return this.app.dismiss(index);
    const fewer = vertex === undefined ? null : entries.deleteVertex(this.entry, index, ring, vertex);
    this.app.drawing.change(fewer ?? entries.removeShape(this.entry, index));
    return this.select(fewer ? { kind, index } : null);
  }

  splitAt(point) {
    this.pen = [...this.pen, point];
    this.app.redraw();
    if (this.pen.length < 2) return;
    const [{ id }, line] = [this.shapes[this.selected.index], this.pen];
    Object.assign(this, { pen: [], tool: "select" });
    cut(this.app, id, line);
  }

  stroke(points) {
    this.pen = [];
    paint(this.app, this.shapes[this.selected.index].id, this.tool, points, this.brush);
  }

  // Drafts

  confirm() {
    const draft = this.selected?.kind === "draft" ? this.app.drafts[this.selected.index] : null;
    if (!draft) return this.app.say("Select a proposed element first, or confirm all with A.");
    this.app.drawing.change(entries.confirm(this.entry, draft, this.app.proposal.occlusion_edges));
    const index = this.entry.elements.length - 1;
    this.app.dropDraft(draft);
    return this.select({ kind: "shape", index });
  }

  confirmAll() {
    const all = this.app.drafts;
    if (all.length === 0) return this.app.say("Nothing is proposed here.");
    this.app.drawing.change(all.reduce((entry, draft) => entries.confirm(entry, draft, this.app.proposal.occlusion_edges), this.entry));
    all.forEach((draft) => this.app.dropDraft(draft));
    this.app.say(`${all.length} elements confirmed.`);
    return this.select(null);
  }

  unsnap() {
    const chosen = this.selected?.kind === "draft" ? this.app.drafts[this.selected.index] : null;
    this.app.setDrafts(this.app.drafts.map((draft) => {
      if (chosen !== null && chosen !== draft) return draft;
      const before = entries.unsnapped(draft);
      this.app.proposal.occlusion_edges = entries.movedAlong(this.app.proposal.occlusion_edges, draft, before);
      return before;
    }));
    this.app.say("Snapping to lines of the image is taken back.");
  }
}

const HINTS = {
  select: () => "Click an element to select it.",
  draw: (label) => `Drawing ${label === "blank" ? "what is left blank" : `a ${label}`}: click its corners; Enter, or a click on the first, closes it; Esc gives up.`,
  split: () => "Click two points of the line to split along.",
  paint: () => "Paint what is seen of the element and has texture; + and − change the brush.",
  erase: () => "Erase what hides the element; + and − change the brush.",
};
