// Pointers (mouse, pen, fingers) on the stage, as clicks and drags at points of the image; wheel and pinch zoom.

/** px of the window that a hand may tremble before a click becomes a drag. */
const TREMBLE = { mouse: 3, pen: 5, touch: 9 };

/**
 * @param editor has hover(point, event), click(point, event), grab(point, event) → whether it takes the drag,
 *   drag(point, event), drop(point, event), cancel()
 */
export function listen(stage, editor) {
  const { svg } = stage;
  const down = new Map();
  let drag = null;
  const at = (event) => stage.toImage(event.clientX, event.clientY);
  const spread = () => {
    const [a, b] = [...down.values()];
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, apart: Math.hypot(a.x - b.x, a.y - b.y) };
  };

  svg.addEventListener("pointerdown", (event) => {
    svg.focus({ preventScroll: true });
    svg.setPointerCapture(event.pointerId);
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (down.size === 2) {
      if (drag?.taken) editor.cancel();
      drag = { pinch: spread() };
    } else if (down.size === 1) {
      const panning = event.button !== 0;
      drag = { from: [event.clientX, event.clientY], start: at(event), begun: false, panning, taken: false };
    }
    event.preventDefault();
  });

  svg.addEventListener("pointermove", (event) => {
    const before = down.get(event.pointerId);
    if (!before) return editor.hover(at(event), event);
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (drag?.pinch && down.size === 2) {
      const [was, is] = [drag.pinch, spread()];
      stage.pan(is.x - was.x, is.y - was.y);
      stage.zoom(is.apart / Math.max(was.apart, 1), is.x, is.y);
      drag.pinch = is;
      return undefined;
    }
    if (!drag || drag.pinch) return undefined;
    if (!drag.begun && Math.hypot(event.clientX - drag.from[0], event.clientY - drag.from[1]) > TREMBLE[event.pointerType]) {
      drag.begun = true;
      drag.taken = !drag.panning && editor.grab(drag.start, event);
    }
    if (drag.taken) editor.drag(at(event), event);
    else if (drag.begun) stage.pan(event.clientX - before.x, event.clientY - before.y);
    return undefined;
  });

  const up = (event, cancelled) => {
    if (!down.delete(event.pointerId)) return;
    if (drag && !drag.pinch) {
      if (cancelled && drag.taken) editor.cancel();
      else if (drag.taken) editor.drop(at(event), event);
      else if (!drag.begun && !drag.panning && !cancelled) editor.click(drag.start, event);
    }
    if (down.size === 0) drag = null;
  };
  svg.addEventListener("pointerup", (event) => up(event, false));
  svg.addEventListener("pointercancel", (event) => up(event, true));
  svg.addEventListener("contextmenu", (event) => event.preventDefault());
  svg.addEventListener("wheel", (event) => {
    event.preventDefault();
    stage.zoom(Math.exp(-event.deltaY * (event.ctrlKey ? 0.01 : 0.0015)), event.clientX, event.clientY);
  }, { passive: false });
}
