// The image with all that is drawn on it, as SVG: zoom, pan, and one group for each layer.
import { isOccluded, shapes } from "./entry.js";
import { edges, middle } from "./geometry.js";

const SVG = "http://www.w3.org/2000/svg";
const MOST_SCALE = 16;
/** px of the window round the image: its border is to be clicked on, too. */
const MARGIN = 14;
/** Of a proposed edge: below, a person would probably move it. */
const CONFIDENT = 0.5;

function made(tag, attributes, ...children) {
  const node = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

const path = (rings, close = "Z") => rings.map((ring) => `M${ring.map(([x, y]) => `${x} ${y}`).join("L")}${close}`).join("");
const titled = (text) => {
  const title = made("title", {});
  title.textContent = text;
  return title;
};

export class Stage {
  constructor(svg, colors) {
    Object.assign(this, { svg, colors, size: [1, 1], view: { scale: 1, x: 0, y: 0 }, fitted: true });
    this.world = made("g", {});
    this.image = made("image", { preserveAspectRatio: "none" });
    this.layers = Object.fromEntries(
      ["uncovered", "shapes", "drafts", "visible", "occlusion", "findings", "handles", "pen", "cursor"].map((name) => [name, made("g", { class: name })]),
    );
    this.world.append(this.image, ...Object.values(this.layers));
    svg.replaceChildren(
      made("defs", {}, made("pattern", { id: "hatch", width: 8, height: 8, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" }, made("rect", { width: 3, height: 8 }))),
      this.world,
    );
    new ResizeObserver(() => (this.fitted ? this.fit() : this.place())).observe(svg);
  }

  showImage(address, width, height) {
    this.size = [width, height];
    for (const [name, value] of Object.entries({ href: address, width, height })) this.image.setAttribute(name, value);
    this.fit();
  }

  // Views

  fit() {
    const { clientWidth, clientHeight } = this.svg;
    const scale = Math.max(Math.min((clientWidth - 2 * MARGIN) / this.size[0], (clientHeight - 2 * MARGIN) / this.size[1]), 0.01);
    this.view = { scale, x: (clientWidth - scale * this.size[0]) / 2, y: (clientHeight - scale * this.size[1]) / 2 };
    this.fitted = true;
    this.place();
  }

  /** Zoom by a factor; what is at (x, y) of the window stays there. */
  zoom(factor, clientX, clientY) {
    const box = this.svg.getBoundingClientRect();
    const [px, py] = [clientX - box.left, clientY - box.top];
    const least = 0.5 * Math.min(box.width / this.size[0], box.height / this.size[1]);
    const scale = Math.min(Math.max(this.view.scale * factor, least), MOST_SCALE);
    const by = scale / this.view.scale;
    this.view = { scale, x: px - by * (px - this.view.x), y: py - by * (py - this.view.y) };
    this.fitted = false;
    this.place();
  }

  pan(dx, dy) {
    this.view = { ...this.view, x: this.view.x + dx, y: this.view.y + dy };
    this.fitted = false;
    this.place();
  }

  place() {
    const { scale, x, y } = this.view;
    this.world.setAttribute("transform", `translate(${x} ${y}) scale(${scale})`);
    this.onplaced?.();
  }

  toImage(clientX, clientY) {
    const box = this.svg.getBoundingClientRect();
    return [(clientX - box.left - this.view.x) / this.view.scale, (clientY - box.top - this.view.y) / this.view.scale];
  }

  toWindow([x, y]) {
    const box = this.svg.getBoundingClientRect();
    return [box.left + this.view.x + x * this.view.scale, box.top + this.view.y + y * this.view.scale];
  }

  inside([x, y]) {
    return [Math.min(Math.max(x, 0), this.size[0]), Math.min(Math.max(y, 0), this.size[1])];
  }

  // Layers

  draw({ entry, drafts, proposal, findings, selected, pen, tool, cursor, brush }) {
    const all = shapes(entry);
    const show = (name, nodes) => this.layers[name].replaceChildren(...nodes);
    show("uncovered", [made("path", { d: path(proposal.uncovered), fill: "url(#hatch)" })]);
    show("shapes", all.map((shape, k) => this.shape(shape, selected?.kind === "shape" && selected.index === k)));
    show("drafts", drafts.map((draft, k) => this.draft(draft, selected?.kind === "draft" && selected.index === k)));
    show("visible", ["paint", "erase"].includes(tool) && selected?.kind === "shape" ? [made("path", { d: path(all[selected.index].visible ?? []) })] : []);
    show("occlusion", entry.occlusion_edges.map((line) => made("path", { d: path([line], "") })));
    show("findings", findings.flatMap((one) => [
      made("path", { d: path([one.where], ""), class: "wrong" }, titled(one.message)),
      ...(one.expected ? [made("path", { d: path([one.expected], ""), class: "expected" }, titled(one.message))] : []),
    ]));
    show("handles", selected && tool === "select" ? this.handles(selected.kind === "shape" ? all[selected.index] : drafts[selected.index], selected, entry) : []);
    show("pen", this.pen(pen));
    show("cursor", cursor ? this.cursor(cursor, brush) : []);
  }

  shape({ id, label, polygons }, isSelected) {
    const color = this.colors[label] ?? "#999";
    const outline = made("path", { d: path(polygons), fill: color, stroke: color, class: isSelected ? "selected" : "" }, titled(`${id} (${label})`));
    return outline;
  }

  draft(draft, isSelected) {
    const color = this.colors[draft.label] ?? "#999";
    const lines = draft.polygons.flatMap(edges).map(([a, b], k) => {
      const sure = (draft.edges[k]?.confidence ?? CONFIDENT) >= CONFIDENT;
      return made("path", { d: path([[a, b]], ""), class: sure ? "sure" : "unsure" });
    });
    const area = made("path", { d: path(draft.polygons), fill: color, class: "area" }, titled(`${draft.id} (proposed ${draft.label})`));
    return made("g", { class: isSelected ? "selected" : "" }, area, ...lines);
  }

  handles(shape, { ring: chosenRing, vertex: chosen }, entry) {
    const radius = 5 / this.view.scale;
    return (shape?.polygons ?? []).flatMap((ring, r) => [
      ...edges(ring).map((edge) => made("path", { d: path([edge], ""), class: isOccluded(entry, edge) ? "edge occluded" : "edge" })),
      ...edges(ring).map(([a, b]) => made("circle", { cx: middle(a, b)[0], cy: middle(a, b)[1], r: 0.6 * radius, class: "new" })),
      ...ring.map(([x, y], k) => made("circle", { cx: x, cy: y, r: radius, class: r === chosenRing && k === chosen ? "chosen" : "" })),
    ]);
  }

  pen(points) {
    if (points.length === 0) return [];
    const radius = 4 / this.view.scale;
    return [made("path", { d: path([points], "") }), ...points.map(([x, y], k) => made("circle", { cx: x, cy: y, r: k === 0 ? 1.6 * radius : radius }))];
  }

  cursor([x, y], brush) {
    const arm = 12 / this.view.scale;
    const cross = made("path", { d: path([[[x - arm, y], [x + arm, y]], [[x, y - arm], [x, y + arm]]], "") });
    return brush ? [cross, made("circle", { cx: x, cy: y, r: brush })] : [cross];
  }
}
