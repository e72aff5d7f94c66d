// Everything round the image: frames, advice, elements, findings, planes. Names come from files: they are text, always.
import { shapes } from "./entry.js";
import { KEYS } from "./keys.js";

export const byId = (id) => document.getElementById(id);

export function node(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

const shown = new WeakMap();

/** Fill a list, unless it says the same already: what has the focus keeps it. */
function fill(id, said, build) {
  const key = JSON.stringify(said);
  if (shown.get(byId(id)) === key) return;
  shown.set(byId(id), key);
  byId(id).replaceChildren(...build());
}

/** Set a text, unless it is the same: screen readers say what is set. */
export function setText(at, text) {
  if (at.textContent !== text) at.textContent = text;
}

export function buildStrip(about, go) {
  byId("strip").replaceChildren(
    ...about.frames.map((frame, k) => {
      const image = node("img", { src: `frames/${k}/thumbnail`, alt: "", loading: "lazy", width: 96, height: Math.round((96 * frame.height) / frame.width) });
      const button = node("button", { type: "button", onclick: () => go(k) }, image, node("span", { className: "name", textContent: frame.name }), node("span", { className: "badge" }), node("span", { className: "count" }));
      button.dataset.frame = k;
      return node("li", {}, button);
    }),
  );
}

export function showStrip(about, state, current) {
  const ious = state.solved?.ious ?? {};
  for (const button of byId("strip").querySelectorAll("button")) {
    const k = Number(button.dataset.frame);
    const found = state.findings.filter((one) => one.frame === about.frames[k].name && !one.outdated).length;
    const drawn = k in state.file.digests;
    const word = k in state.file.unusable ? "damaged" : drawn ? "drawn" : state.file.drafts.includes(k) ? "drafted" : state.next_frames.includes(k) ? "suggested" : "";
    const iou = drawn && ious[k] != null ? ` ${ious[k].toFixed(2)}` : "";
    setText(button.querySelector(".badge"), word + iou);
    setText(button.querySelector(".count"), found ? `${found} !` : "");
    button.title = `${about.frames[k].name} ${word}${iou}${found ? `, ${found} to be looked at` : ""}`;
    button.dataset.is = word;
    if (k === current) button.setAttribute("aria-current", "true");
    else button.removeAttribute("aria-current");
  }
}

export function showAdvice(state, go) {
  const problem = state.problem ? [{ text: state.problem, frame: null, problem: true }] : [];
  const soft = [...state.file.warnings, ...state.warnings].map((text) => ({ text, frame: null, soft: true }));
  const all = [...problem, ...state.advice, ...soft];
  fill("advice", all, () => all.map((one) => {
    const line = node("li", { className: one.problem ? "problem" : one.enough ? "enough" : one.soft ? "soft" : "", textContent: one.text });
    if (one.frame !== null) line.append(" ", node("button", { type: "button", textContent: "Go there", onclick: () => go(one.frame) }));
    return line;
  }));
}

export function showElements(entry, drafts, selected, colors, select) {
  const line = (shape, kind, index) => {
    const isChosen = selected?.kind === kind && selected.index === index;
    const swatch = node("span", { className: "swatch" });
    swatch.style.background = colors[shape.label] ?? "#999";
    const text = `${shape.id} · ${kind === "draft" ? "proposed " : ""}${shape.label}${kind === "shape" && shape.visible?.length ? " · visible parts" : ""}`;
    const button = node("button", { type: "button", onclick: () => select({ kind, index }) }, swatch, text);
    button.setAttribute("aria-pressed", String(isChosen));
    return node("li", { className: kind }, button);
  };
  const all = shapes(entry);
  const said = [...all, ...drafts].map((one) => [one.id, one.label, Boolean(one.visible?.length)]);
  fill("elements", [said, drafts.length, selected?.kind, selected?.index], () => [...all.map((shape, k) => line(shape, "shape", k)), ...drafts.map((draft, k) => line(draft, "draft", k))]);
}

export function showFindings(state, goTo) {
  byId("findings-section").hidden = state.findings.length === 0;
  fill("findings", state.findings, () =>
    state.findings.map((one) => {
      const textContent = `${one.outdated ? "drawn anew since: " : ""}${one.frame}: ${one.message}`;
      return node("li", {}, node("button", { type: "button", className: one.outdated ? "soft" : "", textContent, onclick: () => goTo(one) }));
    }));
}

export function showSolving(state) {
  const { solved } = state;
  const last = solved && `${solved.word ? `${solved.word} · ` : ""}IoU ${solved.iou === null ? "–" : solved.iou.toFixed(3)} · ${solved.full ? "full solve" : "quick solve"}, ${solved.seconds.toFixed(1)} s`;
  const now = { quick: "solving …", full: "solving in full …" }[state.at_work];
  setText(byId("solving"), [now, last].filter(Boolean).join(" · "));
  byId("solving").dataset.word = solved?.word ?? "";
}

export function showPlanes(room, metric) {
  const unit = metric ? "m" : "u";
  byId("room-scale").hidden = room === null;
  const names = Object.entries(room?.position_sigma ?? {});
  const lines = names.map(([name, sigma]) => `${name}: σ ${sigma === null ? "unknown" : `${sigma.toPrecision(2)} ${unit}`}`);
  byId("planes").replaceChildren(...lines.map((textContent) => node("li", { textContent })));
  byId("room").setAttribute("aria-label", room ? `The room in 3D: ${lines.join(", ")}. Arrows turn it.` : "No room yet");
  if (room) byId("room-full").textContent = `${room.sigma_full.toPrecision(2)} ${unit}`;
}

export function showBanner(text, buttons = []) {
  byId("banner").hidden = !text;
  fill("banner", text, () => (text ? [text, ...buttons.map(([textContent, onclick]) => node("button", { type: "button", textContent, onclick }))] : []));
}

export function buildKeys() {
  byId("keys").replaceChildren(...KEYS.flatMap(([keys, what]) => [node("dt", { textContent: keys }), node("dd", { textContent: what })]));
}
