// Puts the page together: the frame that is drawn, the tools, and what the server finds out meanwhile.
import { get } from "./api.js";
import { texture } from "./brush.js";
import { Editor } from "./editor.js";
import * as entries from "./entry.js";
import { FrameDrawing } from "./frame.js";
import * as keys from "./keys.js";
import * as panels from "./panels.js";
import * as pointer from "./pointer.js";
import { Room } from "./room.js";
import { Stage } from "./stage.js";

const { byId } = panels;
const POLL_MS = { busy: 300, idle: 1200 };
const NOTHING_PROPOSED = { elements: [], occlusion_edges: [], uncovered: [] };

class App {
  async start() {
    this.about = await get("about");
    this.colors = Object.fromEntries(this.about.labels.map(({ name, color }) => [name, `rgb(${color.join()})`]));
    Object.assign(this, { drawings: new Map(), frame: 0, drafts: [], proposal: NOTHING_PROPOSED, dismissed: new Set(), roomNumber: 0, proposalOf: "", changes: 0, lastChange: Promise.resolve() });
    document.title = `${this.about.name} · gtlayout annotate`;
    byId("scene-name").textContent = this.about.name;
    this.stage = new Stage(byId("stage"), this.colors);
    this.stage.onplaced = () => this.drawing && this.redraw();
    this.room = new Room(byId("room"));
    this.editor = new Editor(this);
    pointer.listen(this.stage, this.editor);
    keys.listen(this, this.editor, entries);
    this.buildTools();
    panels.buildKeys();
    panels.buildStrip(this.about, (k) => this.go(k));
    this.state = await get("state");
    const drawn = Object.keys(this.state.file.digests).map(Number);
    await this.go(drawn.length ? Math.min(...drawn) : this.state.advice[0]?.frame ?? 0);
    this.poll();
    window.addEventListener("beforeunload", (event) => { if (!this.isSaved) event.preventDefault(); });
  }

  // Frames

  /** To a frame, once all that is drawn in this one is saved. */
  async go(frame) {
    if (this.drawing) {
      await this.lastChange;
      await this.drawing.save();
      if (!this.drawing.isSaved) return this.say("This frame is not saved yet: see above.");
    }
    const drawing = this.drawings.get(frame) ?? new FrameDrawing(frame, (what, text) => this.told(frame, what, text));
    await this.tried(async () => (drawing.isLoaded ? this.follow(drawing, (await get(`frames/${frame}`)).digest) : drawing.load()));
    if (!drawing.isLoaded) return undefined;
    this.drawings.set(frame, drawing);
    Object.assign(this, { frame, drawing, drafts: [], proposal: NOTHING_PROPOSED, proposalOf: "" });
    this.editor.reset();
    const { name, width, height } = this.about.frames[frame];
    this.stage.showImage(`frames/${frame}/image`, width, height);
    this.stage.svg.setAttribute("aria-label", `Image ${name}`);
    byId("strip").querySelector(`[data-frame="${frame}"]`).scrollIntoView({ block: "nearest", inline: "center" });
    this.redraw();
    this.showState();
    await this.propose();
    if (this.drafts.length) return this.say(`${this.drafts.length} elements are proposed in ${name}: Enter confirms the selected one, A all.`);
    return this.say(`${name}. Keys 1 to 6 draw floor, ceiling, wall, slanted, door, window.`);
  }

  step(by) {
    const frame = this.frame + by;
    if (frame >= 0 && frame < this.about.frames.length) this.go(frame);
  }

  goToNext() {
    const to = this.state.advice.find((one) => one.frame !== null)?.frame ?? this.state.next_frames[0];
    if (to === undefined) this.say("No frame is suggested.");
    else this.go(to);
  }

  async goToFinding(finding) {
    await this.go(this.about.frames.findIndex((frame) => frame.name === finding.frame));
    const index = this.editor.shapes.findIndex((shape) => shape.id === finding.element);
    if (index >= 0) this.editor.select({ kind: "shape", index });
    this.say(finding.message);
  }

  /** What others have drawn in the frame meanwhile, when its digest on the server is ``now``. */
  async follow(drawing, now) {
    if (now === drawing.base || !drawing.isSaved || drawing.saving) return;
    await drawing.reload();
    this.say(`${this.about.frames[drawing.index].name} was changed in another window or program: this is what is drawn there now. Undo brings back what was here.`);
  }

  // Proposals

  async propose() {
    const { frame } = this;
    const number = this.state.solved?.number ?? 0;
    if (this.proposalOf === `${frame} ${number}`) return;
    const made = await this.tried(() => get(`frames/${frame}/proposal`));
    if (!made || frame !== this.frame) return;
    this.proposalOf = `${frame} ${number}`;
    this.proposal = made;
    const drawn = new Set(this.editor.entry.elements.map((element) => element.id));
    const chosen = this.editor.selected?.kind === "draft" ? this.drafts[this.editor.selected.index]?.id : null;
    this.drafts = made.elements.filter((draft) => !this.dismissed.has(`${frame} ${draft.id}`) && !drawn.has(draft.id));
    if (chosen !== null) this.editor.selected = this.drafts.some((draft) => draft.id === chosen) ? { kind: "draft", index: this.drafts.findIndex((draft) => draft.id === chosen) } : null;
    this.redraw();
  }

  /** What is no longer drawn is proposed again. */
  async proposeAgain() {
    await this.drawing.save();
    this.proposalOf = "";
    await this.propose();
  }

  setDrafts(drafts) {
    this.drafts = drafts;
    this.redraw();
  }

  dropDraft(draft) {
    this.drafts = this.drafts.filter((one) => one !== draft);
  }

  dismiss(index) {
    this.dismissed.add(`${this.frame} ${this.drafts[index].id}`);
    this.dropDraft(this.drafts[index]);
    this.editor.select(null);
  }

  // The server

  async poll() {
    let busy = false;
    try {
      const { drawing, drawing: { saves } } = this;
      this.state = await get("state");
      busy = this.state.at_work !== null || !this.drawing.isSaved;
      // What was asked before the last save may not know of it.
      const isNew = drawing === this.drawing && saves === drawing.saves && !this.state.file.problem;
      if (isNew) await this.follow(drawing, this.state.file.digests[drawing.index] ?? "");
      if (!this.state.file.problem && drawing.theirs === null && !drawing.isSaved) drawing.save(); // the file is repaired
      this.showState();
      const number = this.state.solved?.number ?? 0;
      if (number !== this.roomNumber) {
        this.roomNumber = number;
        this.room.show(await get("room"));
        panels.showPlanes(this.room.room, this.about.metric);
        await this.propose();
      }
    } catch (problem) {
      byId("solving").textContent = problem.message;
    }
    await new Promise((resolve) => { this.wake = resolve; setTimeout(resolve, busy ? POLL_MS.busy : POLL_MS.idle); });
    this.poll();
  }

  async tried(action) {
    try {
      return (await action()) ?? true;
    } catch (problem) {
      this.say(problem.message);
      return undefined;
    }
  }

  /** A change that the server has a part in: one after another, and saved before another frame is shown. */
  changing(action) {
    this.changes += 1;
    byId("saved").textContent = "saving …";
    this.lastChange = this.lastChange.then(() => this.tried(action)).then(() => {
      this.changes -= 1;
      this.drawing.save();
      this.redraw();
    });
    return this.lastChange;
  }

  /** Whether nothing drawn would be lost if the page were closed now. */
  get isSaved() {
    return this.drawing.isSaved && this.changes === 0;
  }

  told(frame, what, text = "") {
    panels.setText(byId("saved"), { saving: "saving …", saved: "saved", conflict: "not saved", failed: "not saved" }[this.changes && what === "saved" ? "saving" : what]);
    const { name } = this.about.frames[frame];
    if (what === "conflict") {
      const settle = (keepMine) => () => { this.drawings.get(frame).settle(keepMine); panels.showBanner(""); this.redraw(); };
      panels.showBanner(`${name} was changed in another window or program while you drew. Undo brings back the one that you do not choose. `, [["Keep mine", settle(true)], ["Take theirs", settle(false)]]);
    } else if (what === "failed") {
      panels.showBanner(`${name} is not saved: ${text} `, [["Try again", () => this.drawing.save()]]);
    } else if (what === "saved") {
      panels.showBanner("");
      this.wake?.(); // what follows from it is shown as soon as it is known
    }
  }

  // What is shown

  buildTools() {
    const labels = [...this.about.labels.map(({ name }) => name), "blank"];
    byId("labels").replaceChildren(
      ...labels.map((label, k) => {
        const button = panels.node("button", { type: "button" }, `${label} `, panels.node("kbd", { textContent: k + 1 }));
        Object.assign(button.dataset, { tool: "draw", label });
        button.setAttribute("aria-keyshortcuts", String(k + 1));
        button.style.borderBottomColor = this.colors[label] ?? "#999";
        return button;
      }),
    );
    for (const button of document.querySelectorAll("[data-tool]")) button.addEventListener("click", () => { this.editor.setTool(button.dataset.tool, button.dataset.label); this.stage.svg.focus(); });
    for (const button of document.querySelectorAll("[data-do]")) button.addEventListener("click", () => { this.run(button.dataset.do); this.stage.svg.focus(); });
  }

  run(what) {
    const actions = {
      undo: () => { this.drawing.undo(); this.editor.reset(); this.proposeAgain(); },
      redo: () => { this.drawing.redo(); this.editor.reset(); this.proposeAgain(); },
      snap: () => { this.editor.snapping = !this.editor.snapping; this.say(this.editor.snapping ? "Snapping is on." : "Snapping is off."); },
      fit: () => this.stage.fit(),
      texture: () => this.proposeVisible(),
      confirm: () => this.editor.confirm(),
      "confirm-all": () => this.editor.confirmAll(),
      unsnap: () => this.editor.unsnap(),
      delete: () => this.editor.remove(),
    };
    actions[what]();
    this.redraw();
  }

  /** Of the selected element, or of all that have no visible parts yet. */
  async proposeVisible() {
    const { selected, shapes } = this.editor;
    const chosen = selected?.kind === "shape" ? [shapes[selected.index]] : shapes.filter((shape) => !shape.visible?.length);
    await texture(this, chosen.filter((shape) => shape.label !== "blank").map((shape) => shape.id));
    if (selected?.kind === "shape") this.editor.tool = "paint";
    this.redraw();
  }

  say(text) {
    panels.setText(byId("hint"), text);
  }

  redraw() {
    const { editor } = this;
    const findings = (this.state?.findings ?? []).filter((one) => one.frame === this.about.frames[this.frame].name && !one.outdated);
    const isBrush = editor.tool === "paint" || editor.tool === "erase";
    this.stage.draw({ entry: editor.entry, drafts: this.drafts, proposal: this.proposal, findings, selected: editor.selected, pen: editor.pen, tool: editor.tool, cursor: editor.tool === "select" && editor.isPointed ? null : editor.cursor, brush: isBrush ? editor.brush : 0 });
    panels.showElements(editor.entry, this.drafts, editor.selected, this.colors, (one) => { editor.select(one); this.stage.svg.focus(); });
    byId("draft-count").textContent = this.drafts.length ? `${this.drafts.length} proposed` : "nothing proposed";
    for (const button of byId("draft-bar").querySelectorAll("button")) button.disabled = this.drafts.length === 0;
    for (const button of document.querySelectorAll("[data-tool]")) {
      button.setAttribute("aria-pressed", String(button.dataset.tool === editor.tool && (editor.tool !== "draw" || button.dataset.label === editor.label)));
    }
    document.querySelector("[data-do=snap]").setAttribute("aria-pressed", String(editor.snapping));
    this.stage.svg.dataset.tool = editor.tool;
  }

  showState() {
    const { state } = this;
    panels.showStrip(this.about, state, this.frame);
    panels.showAdvice(state, (frame) => this.go(frame));
    panels.showFindings(state, (finding) => this.goToFinding(finding));
    panels.showSolving(state);
    const why = state.file.problem || state.file.unusable[this.frame];
    if (why) panels.showBanner(`${why} Nothing is saved until it is repaired; what you draw stays in this window. `, [["Try again", () => this.drawing.save()]]);
    else if (this.drawing.isSaved) panels.showBanner("");
    if (this.isSaved && !why) panels.setText(byId("saved"), "saved");
    const found = state.findings.map((one) => `${one.outdated} ${one.frame} ${one.message}`).join("\n");
    if (found !== this.foundBefore) {
      this.foundBefore = found;
      this.redraw();
    }
  }
}

const app = new App();
app.start().catch((problem) => panels.showBanner(`The page cannot start: ${problem.message}`));
