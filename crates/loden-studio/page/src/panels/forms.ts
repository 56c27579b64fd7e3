/** What is asked of each way to a new material. */

import { get, texels } from "../api";
import { fill, h } from "../dom";
import { extend, painted, read, runs, type Stroke, written } from "../mask";
import { type Details, type Material, model } from "../model";
import { form } from "../params";
import { state, type State } from "../state";
import { number, t } from "../texts";
import type { Pointed, Texture } from "../texture";
import { button, choice, type Control, field, line, report, segmented, slider, toggle } from "../widgets";
import { materialChoice } from "./common";

export interface Form {
  root: HTMLElement;
  kind: string;
  suffix: string;
  request(name: string): Record<string, unknown> | null;
  /** Takes a click on a texel of the material. */
  pick?(texel: Pointed): void;
  /** Shows the state. */
  show?(now: State, source: Material): void;
  /** A request whose result is shown at once; none if nothing would change, or it takes too long. */
  trial?(): Record<string, unknown> | null;
}

/** What the forms work on. */
export interface Context {
  source(): Material | undefined;
  details(): Details | undefined;
  image: Texture;
  /** Starts a job whose pictures are shown. */
  try(kind: string, request: Record<string, unknown>): void;
}

export function enlarge({ source }: Context): Form {
  const methods = model.tables.syntheses;
  const place = h("div");
  const doc = h("p", { class: "hint" });
  let params = form([]);
  const method = choice(methods.map((one) => ({ value: one.name, label: one.name, doc: one.doc })), model.tables.synthesis, () => take());
  const take = () => {
    const chosen = methods.find((one) => one.name === method.get())!;
    params = form(chosen.params);
    doc.textContent = chosen.doc;
    fill(place, chosen.params.length ? h("details", {}, h("summary", {}, t("parameters")), params.root) : null);
  };
  const sides = [128, 256, 512, 1024].map((side) => ({ value: String(side), label: String(side) }));
  const [width, height] = [t("width"), t("height")].map((label) => segmented(sides, "256", () => {}, label)) as [Control<string>, Control<string>];
  const tileable = toggle(t("tileable"), false, () => {});
  const seed = slider({ min: 0, max: 99, step: 1, value: 0 }, () => {});
  take();
  return {
    root: h("div", {}, h("div", { class: "fields" }, field(t("method"), method.root), doc, field(t("width"), width.root), field(t("height"), height.root), tileable.root, field(t("seed"), seed.root)), place),
    kind: "synthesize",
    suffix: "large",
    request(name) {
      const material = source();
      if (!material || !params.ok()) return null;
      return { material: material.id, method: method.get(), params: params.get(), size: [Number(width.get()), Number(height.get())], tileable: tileable.get(), seed: seed.get(), name };
    },
  };
}

/** The second material. */
function second(label: string) {
  const control = materialChoice(label, ["btf", "compressed"], (id) => state.change({ with: id, c: undefined, try: undefined }));
  return {
    root: control.root,
    show(now: State) {
      control.refresh();
      control.set(model.material(now.with) ? now.with! : "");
    },
    get(): string | null {
      if (control.get()) return control.get();
      report(new Error(t("choose-second")));
      return null;
    },
  };
}

/** Materials of a grid, at most. */
const GRID = 5;

export function exchange({ source, try: start }: Context): Form {
  const other = second(t("reflectance"));
  const shading = toggle(t("keep-shading"), true, () => {});
  const list = h("div", { class: "fields tight" });
  const chosen = () => (state.now.more ?? "").split(" ").filter((id) => model.material(id));
  const materials = () => [...new Set([source()?.id ?? "", state.now.with ?? "", ...chosen()])].filter((id) => model.material(id));
  const grid = button(
    t("grid"),
    () => {
      const all = materials();
      if (all.length < 2) return report(new Error(t("choose-second")));
      state.change({ more: all.join(" ") });
      start("grid", { materials: all, shading: shading.get() });
    },
    { kind: "wide" },
  );
  return {
    root: h("div", { class: "fields" }, other.root, shading.root, h("div", { class: "group" }, h("h2", { class: "sub" }, t("grid-title")), h("p", { class: "hint" }, t("grid-text")), list, grid)),
    kind: "exchange",
    suffix: "exchanged",
    show(now, material) {
      other.show(now);
      const on = new Set(chosen());
      const offered = model.of("btf", "compressed").filter((one) => one.id !== material.id && one.id !== now.with).slice(0, 12);
      const key = JSON.stringify([offered.map((one) => one.id), [...on]]);
      if (list.dataset.key === key) return;
      list.dataset.key = key;
      const set = (id: string, add: boolean) => {
        const next = chosen().filter((one) => one !== id);
        if (add && materials().length >= GRID) return report(new Error(t("grid-most", { most: GRID })));
        state.change({ more: (add ? [...next, id] : next).join(" ") || undefined });
      };
      fill(list, ...offered.map((one) => toggle(one.name, on.has(one.id), (add) => set(one.id, add)).root));
    },
    request(name) {
      const structure = source();
      const reflectance = other.get();
      return structure && reflectance ? { structure: structure.id, reflectance, shading: shading.get(), name } : null;
    },
  };
}

/** Steps that are computed between two materials, both included. */
const STEPS = 5;

export function mix(context: Context): Form {
  const { source, try: start } = context;
  const other = second(t("mixed-with"));
  const amount = slider({ min: 0, max: 1, step: 0.01, value: 0.5 }, (amt, done) => state.change({ amt, c: undefined }, done));
  const brush = painter(context);
  const where = segmented([{ value: "", label: t("everywhere") }, { value: "mask", label: t("painted") }], "", (on) => state.change({ on: on || undefined }), t("where"));
  const steps = button(
    t("steps"),
    () => {
      const [first, with_] = [source(), other.get()];
      if (first && with_) start("steps", { first: first.id, second: with_, count: STEPS });
    },
    { kind: "wide" },
  );
  return {
    root: h("div", { class: "fields" }, other.root, field(t("amount"), amount.root, t("amount-hint")), h("p", { class: "hint" }, t("steps-text")), steps, field(t("where"), where.root), brush.root),
    kind: "blend",
    suffix: "mixed",
    show(now) {
      other.show(now);
      amount.set(Math.min(1, Math.max(0, now.amt ?? 0.5)));
      where.set(now.on === "mask" ? "mask" : "");
      brush.show(now.on === "mask");
    },
    request(name) {
      const [first, with_] = [source(), other.get()];
      if (!first || !with_) return null;
      const mask = state.now.on === "mask" ? brush.mask() : null;
      if (state.now.on === "mask" && !mask) return null;
      return { first: first.id, second: with_, amount: amount.get(), mask, name };
    },
  };
}

/** Changes of an edit: name, least, largest, step, neutral value, unit, logarithmic. */
const CHANGES = [
  ["hue", -180, 180, 1, 0, "°", false],
  ["saturation", 0, 2, 0.01, 1, "", false],
  ["gloss", 0.25, 4, 0.01, 1, "", true],
  ["highlights", 0, 3, 0.01, 1, "", false],
  ["contrast", 0, 2, 0.01, 1, "", false],
  ["exposure", -3, 3, 0.05, 0, "stops", false],
] as const;

const NEUTRAL = CHANGES.map(([, , , , neutral]) => neutral);

function changesOf(now: State): number[] {
  const numbers = (now.ed ?? "").split(",").map(Number);
  return numbers.length === CHANGES.length && numbers.every(Number.isFinite) ? numbers : NEUTRAL;
}

export function edit(context: Context): Form {
  const { source, details } = context;
  const change = (k: number, value: number, done: boolean) => {
    const next = changesOf(state.now).map((old, at) => (at === k ? value : old));
    state.change({ ed: next.every((one, at) => one === NEUTRAL[at]) ? undefined : next.join(), c: undefined }, done);
  };
  const sliders = CHANGES.map(([, min, max, step, value, unit, log], k) =>
    slider({ min, max, step, value, unit: unit === "stops" ? t("stops") : unit, log }, (next, done) => change(k, next, done)),
  );
  const region = regions(context);
  const note = h("p", { class: "hint" });
  return {
    root: h("div", { class: "fields" }, ...CHANGES.map(([name], k) => field(t(name), sliders[k]!.root)), region.root, note),
    kind: "edit",
    suffix: "edited",
    pick: region.pick,
    show(now) {
      changesOf(now).forEach((value, k) => sliders[k]!.set(value));
      region.show(now);
      note.textContent = t(details()?.has_rows ? "preview-text" : "no-preview-text");
    },
    request(name) {
      const on = source() ? region.get(true) : null;
      return on ? { material: source()!.id, ...values(), on, name } : null;
    },
    trial() {
      const on = region.get(false);
      const neutral = changesOf(state.now).every((one, at) => one === NEUTRAL[at]);
      return on && !neutral && details()?.has_rows ? { material: source()!.id, ...values(), on } : null;
    },
  };
}

function values(): Record<string, number> {
  return Object.fromEntries(CHANGES.map(([name], k) => [name, changesOf(state.now)[k]!]));
}

/** Chooses what an edit changes. */
function regions(context: Context) {
  const names = ["", "near", "rows", "colors", "mask"] as const;
  const labels = { "": "everywhere", near: "around-texel", rows: "by-rows", colors: "by-color", mask: "painted" } as const;
  const where = choice(names.map((value) => ({ value, label: t(labels[value]), doc: t(`${labels[value]}-doc`) })), "", (on) => state.change({ on: on || undefined, near: undefined, c: undefined }));
  const radius = slider({ min: 1, max: 60, step: 1, value: 10 }, (value, done) => change({ radius: value }, done));
  const color = line("", (text) => /^[0-9a-f]{6}$/i.test(text) && change({ color: text.toLowerCase() }, "quiet"));
  const swatch = h("span", { class: "swatch" });
  const list = h("p", { class: "hint" });
  const clear = button(t("clear"), () => state.change({ rows: undefined, c: undefined }));
  const brush = painter(context);
  const near = h("div", { class: "fields" }, h("p", { class: "hint" }, t("pick-texel")));
  const rows = h("div", { class: "fields" }, h("p", { class: "hint" }, t("pick-rows")), h("div", { class: "row between" }, list, clear));
  const colors = h("div", { class: "fields" }, h("p", { class: "hint" }, t("pick-color")), field(t("color"), h("div", { class: "row" }, swatch, color.root)));
  color.root.setAttribute("aria-label", t("color"));
  const reach = field(t("similar"), radius.root);
  const root = h("div", { class: "fields" }, field(t("where"), where.root), near, rows, colors, reach, brush.root);
  // the colour and the radius, `e0c030,10`
  const reachOf = (now: State) => {
    const [text = "", size = ""] = (now.near ?? "").split(",");
    return { color: /^[0-9a-f]{6}$/.test(text) ? text : "", radius: Number(size) >= 1 && Number(size) <= 60 ? Number(size) : 10 };
  };
  const change = (part: { color?: string; radius?: number }, step: boolean | "quiet" = true) => {
    const next = { ...reachOf(state.now), ...part };
    state.change({ near: `${next.color},${next.radius}`, c: undefined }, step);
  };
  const chosenRows = () => (state.now.rows ?? "").split(",").filter((text) => /^\d+$/.test(text)).map(Number);
  const picked = async (material: Material, { x, y }: Pointed) => {
    if (!context.details()?.has_rows) return report(new Error(t("no-rows", { name: material.name })));
    const found = await get<{ row: number; texels: number; color: string }>("row", { m: material.id, x, y });
    if (state.now.on === "colors") return change({ color: found.color });
    const before = chosenRows();
    const next = before.includes(found.row) ? before.filter((row) => row !== found.row) : [...before, found.row].sort((a, b) => a - b);
    state.change({ rows: next.join() || undefined, c: undefined });
  };
  const tint = async (material: Material, rows: number[]) => {
    const index = await indexOf(material);
    if (state.now.m !== material.id || state.now.on !== "rows") return;
    const chosen = new Set(rows);
    context.image.tint(Uint8Array.from(index, (row) => (chosen.has(row) ? 1 : 0)));
  };
  return {
    root,
    pick({ x, y }: Pointed) {
      const material = context.source();
      if (state.now.on === "near") state.change({ x, y, c: undefined });
      else if (material && ["rows", "colors"].includes(state.now.on ?? "")) void picked(material, { x, y }).catch(report);
    },
    show(now: State) {
      const on = names.find((name) => name === now.on) ?? "";
      where.set(on);
      near.hidden = on !== "near";
      rows.hidden = on !== "rows";
      colors.hidden = on !== "colors";
      reach.hidden = !["near", "colors"].includes(on);
      const { color: text, radius: size } = reachOf(now);
      radius.set(size);
      if (document.activeElement !== color.root) color.set(text);
      swatch.style.background = text ? `#${text}` : "";
      const numbers = chosenRows();
      list.textContent = numbers.length ? t("rows-chosen", { rows: numbers.join(", ") }) : t("rows-none");
      brush.show(on === "mask");
      const material = context.source();
      if (on === "rows" && numbers.length && material && context.details()?.has_rows) void tint(material, numbers).catch(report);
      else if (on === "rows") context.image.tint(null);
    },
    get(isAsked: boolean): unknown {
      const missing = (text: string) => {
        if (isAsked) report(new Error(text));
        return null;
      };
      const { x, y, on } = state.now;
      const { color: text, radius: size } = reachOf(state.now);
      if (on === "near") return x === undefined || y === undefined ? missing(t("pick-texel")) : { grow: { texel: [x, y], similar: size } };
      if (on === "rows") return chosenRows().length ? { rows: chosenRows() } : missing(t("pick-rows"));
      if (on === "colors") return text ? { colors: { center: text, radius: size } } : missing(t("pick-color"));
      if (on === "mask") {
        const mask = brush.mask(isAsked);
        return mask && { mask };
      }
      return "all";
    },
  };
}

const indices = new Map<string, Promise<Uint16Array>>();

/** The row of each texel of a material that has rows. */
function indexOf({ id, modified }: Material): Promise<Uint16Array> {
  const key = `${id} ${modified}`;
  const load = async () => {
    const planes = await get<{ rows?: number }[]>("parts", { m: id });
    const { width, height, rgba } = await texels("part", { m: id, plane: planes.findIndex((plane) => plane.rows !== undefined), view: 0, component: 0 });
    return Uint16Array.from({ length: width * height }, (_, k) => rgba.data[4 * k]! + 256 * rgba.data[4 * k + 1]!);
  };
  if (!indices.has(key)) indices.set(key, load());
  return indices.get(key)!;
}

/** A brush that paints on the image of the material. */
function painter({ image, source }: Context) {
  const size = slider({ min: 1, max: 64, step: 1, value: 6, log: true }, () => {});
  let erases = false;
  const how = segmented([{ value: "paint", label: t("paint") }, { value: "erase", label: t("erase") }], "paint", (value) => (erases = value === "erase"), t("brush"));
  const count = h("span", { class: "hint" });
  const clear = button(t("clear"), () => state.change({ paint: undefined, c: undefined }));
  const root = h("div", { class: "fields", hidden: true }, h("p", { class: "hint" }, t("paint-hint")), field(t("brush"), how.root), field(t("brush-size"), size.root), h("div", { class: "row between" }, count, clear));
  let stroke: Stroke | null = null;
  const strokes = () => read(state.now.paint ?? "");
  const maskOf = (all: Stroke[]) => painted(all, source()?.width ?? 1, source()?.height ?? 1);
  const tool = ({ x, y }: Pointed, phase: "down" | "move" | "up") => {
    if (phase === "down") stroke = { radius: size.get() / 2, erases, points: [] };
    if (!stroke) return;
    if (phase !== "up" && !extend(stroke, [x, y])) return;
    if (phase !== "up") return image.tint(maskOf([...strokes(), stroke]));
    const done = stroke;
    stroke = null;
    if (done.points.length) state.change({ paint: written([...strokes(), done]), c: undefined });
  };
  return {
    root,
    show(on: boolean) {
      root.hidden = !on;
      if (!on) return;
      image.tool = tool;
      const mask = maskOf(strokes());
      const covered = mask.reduce((sum, one) => sum + one, 0);
      count.textContent = t("painted-share", { share: number((100 * covered) / mask.length, 2) });
      if (!stroke) image.tint(mask);
    },
    mask(isAsked = true): { width: number; height: number; runs: number[] } | null {
      const mask = maskOf(strokes());
      if (mask.includes(1)) return { width: source()!.width ?? 1, height: source()!.height ?? 1, runs: runs(mask) };
      if (isAsked) report(new Error(t("nothing-painted")));
      return null;
    },
  };
}
