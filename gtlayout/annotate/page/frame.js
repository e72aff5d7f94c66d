// One frame while it is drawn: undo, redo, and saving at every change.
import { Conflict, Unreachable, get, put } from "./api.js";
import { nothing } from "./entry.js";

const RETRY_MS = 2000;

export class FrameDrawing {
  /** @param told called with "saving", "saved", "conflict" or "failed" and what there is to say of it */
  constructor(index, told) {
    const entry = nothing();
    Object.assign(this, { index, told, entry, saved: entry, isLoaded: false, base: "", past: [], future: [], saving: null, theirs: null, saves: 0 });
  }

  async load() {
    const { entry, digest } = await get(`frames/${this.index}`);
    const now = entry ?? nothing();
    Object.assign(this, { entry: now, saved: now, base: digest, isLoaded: true });
  }

  /** What was drawn elsewhere takes the place of what is drawn here, which can be had back by undo. */
  async reload() {
    const before = this.entry;
    await this.load();
    this.past.push(before);
    this.future = [];
  }

  get isSaved() {
    return this.entry === this.saved;
  }

  change(entry) {
    if (entry === this.entry) return;
    this.past.push(this.entry);
    this.future = [];
    this.show(entry);
  }

  undo() {
    if (this.past.length === 0) return;
    this.future.push(this.entry);
    this.show(this.past.pop());
  }

  redo() {
    if (this.future.length === 0) return;
    this.past.push(this.entry);
    this.show(this.future.pop());
  }

  show(entry) {
    this.entry = entry;
    this.save();
  }

  /** One request at a time; what is drawn meanwhile goes with the next. Resolves when all is saved, or cannot be. */
  save() {
    this.saving ??= this.saveAll().finally(() => { this.saving = null; });
    return this.saving;
  }

  async saveAll() {
    while (!this.isSaved && this.theirs === null) {
      const entry = this.entry;
      this.told("saving");
      try {
        this.base = (await put(`frames/${this.index}`, { entry, base: this.base })).digest;
        this.saved = entry;
        this.saves += 1;
      } catch (problem) {
        if (problem instanceof Conflict) {
          this.theirs = problem.now;
          return this.told("conflict");
        }
        this.told("failed", problem.message);
        if (!(problem instanceof Unreachable)) return undefined;
        await new Promise((resolve) => setTimeout(resolve, RETRY_MS));
      }
    }
    return this.told("saved");
  }

  /** Settle a conflict. The state that loses is what undo comes to first. */
  settle(keepMine) {
    const theirs = this.theirs.entry ?? nothing();
    const mine = this.entry;
    Object.assign(this, { base: this.theirs.digest, saved: theirs, theirs: null, future: [] });
    this.past.push(keepMine ? theirs : mine);
    this.show(keepMine ? mine : theirs);
  }
}
