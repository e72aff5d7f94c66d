// Keys on the stage. All that pointers do can be done with them: arrows move a cross, Space clicks at it.
import { shapes } from "./entry.js";
import { rounded } from "./geometry.js";

export const KEYS = [
  ["1 … 6", "draw floor, ceiling, wall, slanted, door, window; with Shift: relabel"],
  ["7", "draw what is deliberately left blank"],
  ["arrows", "move the cross, or the selected corner; 10 px with Shift"],
  ["Space", "click at the cross"],
  ["Enter", "close the outline; confirm the selected proposal"],
  ["Backspace", "take back the last corner"],
  ["Esc", "give up, deselect"],
  ["[ and ]", "previous and next element"],
  [", and .", "previous and next corner"],
  ["O", "occlusion edge: the edge after the selected corner"],
  ["I", "new corner in that edge"],
  ["Del", "delete the corner, the element or the proposal"],
  ["X, B, E, V", "split, paint visible parts, erase them, select"],
  ["T", "propose visible parts"],
  ["A, R", "confirm all proposals; take their snapping back"],
  ["N", "snap to corners and edges; Alt suspends it"],
  ["Z, Y", "undo, redo (with or without Ctrl)"],
  ["+, −, H", "zoom (with a brush: its size), whole image"],
  ["Page Up, Page Down", "previous and next frame"],
  ["S", "the frame to draw next"],
];

const STEP = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export function listen(app, editor, entries) {
  const { stage } = app;

  function arrow([dx, dy], event) {
    const by = event.shiftKey ? 10 : 1;
    const { selected } = editor;
    if (editor.tool === "select" && selected?.vertex !== undefined) {
      if (selected.kind === "draft") return editor.confirm();
      const from = editor.shapes[selected.index].polygons[selected.ring][selected.vertex];
      const to = rounded(stage.inside([from[0] + by * dx, from[1] + by * dy]));
      const moved = entries.movePoints(editor.entry, (p) => (p[0] === from[0] && p[1] === from[1] ? to : p));
      app.drawing.change(moved);
      return app.redraw();
    }
    const [x, y] = editor.cursor ?? stage.size.map((side) => Math.round(side / 2));
    editor.isPointed = false;
    editor.cursor = stage.inside([x + by * dx, y + by * dy]);
    app.say(`${editor.cursor.map(Math.round).join(", ")} px`);
    return app.redraw();
  }

  const cycle = (index, step, count) => (count === 0 ? undefined : ((index ?? (step > 0 ? -1 : count)) + step + count) % count);

  function nextShape(step) {
    const [drawn, drafts] = [shapes(editor.entry).length, app.drafts.length];
    const now = editor.selected && (editor.selected.kind === "shape" ? 0 : drawn) + editor.selected.index;
    const next = cycle(now ?? undefined, step, drawn + drafts);
    if (next !== undefined) editor.select(next < drawn ? { kind: "shape", index: next } : { kind: "draft", index: next - drawn });
  }

  function nextCorner(step) {
    const { selected } = editor;
    if (!selected) return;
    const shape = (selected.kind === "shape" ? editor.shapes : app.drafts)[selected.index];
    const corners = shape.polygons.flatMap((ring, r) => ring.map((_, k) => ({ ring: r, vertex: k })));
    const now = corners.findIndex((one) => one.ring === selected.ring && one.vertex === selected.vertex);
    editor.select({ ...selected, ...corners[cycle(now < 0 ? undefined : now, step, corners.length)] });
    const { ring, vertex } = editor.selected;
    app.say(`corner ${vertex + 1} of ${shape.id}: ${shape.polygons[ring][vertex].map(Math.round).join(", ")} px`);
  }

  /** The edge after the selected corner. */
  function ownEdge() {
    const { selected } = editor;
    if (selected?.kind !== "shape" || selected.vertex === undefined) return app.say("Select a corner first (, and .): the edge after it is meant.");
    const ring = editor.shapes[selected.index].polygons[selected.ring];
    return [ring[selected.vertex], ring[(selected.vertex + 1) % ring.length]];
  }

  const actions = {
    v: () => editor.setTool("select"), x: () => editor.setTool("split"), b: () => editor.setTool("paint"), e: () => editor.setTool("erase"),
    t: () => app.run("texture"), a: () => app.run("confirm-all"), r: () => app.run("unsnap"), n: () => app.run("snap"),
    z: () => app.run("undo"), y: () => app.run("redo"), h: () => app.run("fit"), s: () => app.goToNext(),
    "[": () => nextShape(-1), "]": () => nextShape(1), ",": () => nextCorner(-1), ".": () => nextCorner(1),
    Delete: () => editor.remove(), PageUp: () => app.step(-1), PageDown: () => app.step(1),
    Escape: () => { editor.cancel(); if (editor.tool === "select") editor.select(null); else editor.setTool("select"); },
    Enter: () => (editor.tool === "draw" ? editor.finish() : app.run("confirm")),
    Backspace: () => { editor.pen = editor.pen.slice(0, -1); app.redraw(); },
    " ": () => { if (editor.cursor) editor.click(editor.cursor, {}); },
    o: () => { const edge = ownEdge(); if (edge) { app.drawing.change(entries.toggleOcclusion(editor.entry, edge)); app.redraw(); } },
    i: () => {
      const edge = ownEdge();
      if (!edge) return;
      const { index, ring, vertex } = editor.selected;
      app.drawing.change(entries.insertVertex(editor.entry, index, ring, vertex, rounded([(edge[0][0] + edge[1][0]) / 2, (edge[0][1] + edge[1][1]) / 2])));
      editor.select({ ...editor.selected, vertex: vertex + 1 });
    },
    "+": () => bigger(1.25), "=": () => bigger(1.25), "-": () => bigger(0.8),
  };

  function bigger(factor) {
    if (editor.tool === "paint" || editor.tool === "erase") {
      editor.brush = Math.min(Math.max(editor.brush * factor, 2), 200);
      return app.redraw();
    }
    const [x, y] = stage.toWindow(editor.cursor ?? stage.size.map((side) => side / 2));
    return stage.zoom(factor, x, y);
  }

  stage.svg.addEventListener("keydown", (event) => {
    if (event.metaKey || (event.ctrlKey && !["z", "y"].includes(event.key.toLowerCase()))) return;
    const digit = /^Digit([1-7])$/.exec(event.code)?.[1];
    const labels = [...app.about.labels.map((label) => label.name), "blank"];
    if (digit && event.shiftKey) editor.relabel(labels[digit - 1]);
    else if (digit) editor.setTool("draw", labels[digit - 1]);
    else if (event.key in STEP) arrow(STEP[event.key], event);
    else {
      const redo = event.shiftKey && event.key === "Z";
      const action = redo ? actions.y : actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
      if (!action) return;
      action();
    }
    event.preventDefault();
  });
}
