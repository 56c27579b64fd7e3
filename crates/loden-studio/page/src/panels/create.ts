/** New materials: larger ones, exchanged ones, edited ones. */

import { Scrub, texels } from "../api";
import { Pairs } from "../directions";
import { fill, h } from "../dom";
import { bar, doing, jobs } from "../jobs";
import { type Job, type Material, model, stem } from "../model";
import { form } from "../params";
import { state, type State } from "../state";
import { t } from "../texts";
import { Linked, texture, zoomer } from "../texture";
import { button, choice, type Control, empty, field, line, report, segmented, slider, toggle } from "../widgets";
import { go, materialChoice, only, type Panel } from "./common";

interface Form {
  root: HTMLElement;
  kind: string;
  suffix: string;
  request(name: string): Record<string, unknown> | null;
}

const TASKS = ["enlarge", "exchange", "edit"] as const;

export function create(): Panel {
  const root = h("section", { class: "panel" });
  const none = empty(t("no-create"), t("no-create-text"), button(t("go-gallery"), () => go("gallery"), { kind: "primary" }));
  const material = materialChoice(t("material"), ["btf", "compressed"], (m) => state.change({ m, x: undefined, y: undefined }));
  const task = segmented(TASKS.map((value) => ({ value, label: t(value) })), "enlarge", (how) => state.change({ how, c: undefined }), t("create"));
  const text = h("p", { class: "hint" });
  const place = h("div");
  const [before, after] = [picture(t("before"), true), picture(t("after"), false)];
  const name = line("", () => (named = true));
  const progress = bar(t("create"));
  const what = h("span", { class: "doing" });
  const stop = button(t("cancel"), () => job !== null && void jobs.cancel(job));
  const running = h("div", { class: "running" }, progress.root, h("div", { class: "job-line" }, what), stop);
  const start = button(t("start"), () => begin(), { kind: "primary wide" });
  const maker = h("div", { class: "maker" }, place, h("div", { class: "fields" }, field(t("name"), name.root)), start, running);
  const side = h("aside", { class: "side" }, material.root, task.root, text, maker);
  const whole = h("div", { class: "columns two" }, side, h("div", { class: "main pair-view" }, before.root, after.root));
  let named = false;
  let job: number | null = null;
  let source: Material | undefined;
  const forms: Record<string, Form> = { enlarge: enlarge(() => source), exchange: exchange(() => source), edit: edit(() => source) };
  const current = () => (TASKS.includes(state.now.how as (typeof TASKS)[number]) ? state.now.how! : "enlarge");

  const suggest = () => {
    if (source && !named) name.set(model.freeName(`${stem(source.name)}-${forms[current()]!.suffix}`, "loden"));
  };
  const follow = (now: Job) => {
    progress.show(now);
    what.textContent = doing(now);
    if (!["done", "failed", "cancelled"].includes(now.phase)) return;
    job = null;
    maker.classList.remove("busy");
    named = false;
    if (now.phase !== "done") return;
    void model.refresh().then(() => {
      const made = model.listed.materials.find((one) => one.name === now.title);
      if (made && state.now.panel === "create") state.change({ c: made.id });
      suggest();
    }, report);
  };
  const begin = () => {
    const request = forms[current()]!.request(name.get());
    if (!request) return;
    void jobs.start(forms[current()]!.kind, request, follow).then((started) => {
      job = started.id;
      maker.classList.add("busy");
      follow(started);
    }, report);
  };
  const show = (now: State) => {
    material.refresh();
    source = model.of("btf", "compressed").find((one) => one.id === now.m);
    if (!source) {
      only(root, none);
      return;
    }
    only(root, whole);
    material.set(source.id);
    task.set(current());
    text.textContent = t(`${current() as (typeof TASKS)[number]}-text`);
    only(place, forms[current()]!.root);
    suggest();
    before.show(source);
    after.show(model.material(now.c));
  };
  return { root, show };
}

/** An image of a material under light from the side. */
function picture(title: string, pick: boolean) {
  const linked = new Linked();
  const image = texture(linked, title, pick ? ({ x, y }) => state.change({ x, y }) : undefined);
  const caption = h("span", {}, "");
  const actions = h("span", { class: "row" });
  const hint = h("p", { class: "hint center overlay" }, t("result-here"));
  const root = h("div", { class: "viewer" }, h("header", { class: "bar-line" }, h("strong", {}, title), caption, h("span", { class: "grow" }), actions, zoomer(linked)), h("div", { class: "stage-place" }, image.root, hint));
  const scrub = new Scrub();
  let drawn = "";
  const show = (material: Material | undefined) => {
    const { x, y } = state.now;
    image.choose(pick && x !== undefined && y !== undefined ? { x, y } : null);
    caption.textContent = material?.name ?? "";
    hint.hidden = Boolean(material);
    const key = material ? `${material.id} ${material.modified}` : "";
    if (key === drawn) return;
    drawn = key;
    linked.fit();
    image.draw(null);
    fill(actions, material && !pick ? button(t("look"), () => go("originals", { m: material.id, c: undefined, how: undefined })) : null, material?.holds === "compressed" && !pick ? button(t("view"), () => go("view", { m: material.id, how: undefined })) : null);
    if (!material) return;
    scrub.run(async () => {
      try {
        const pairs = new Pairs(await model.detailsOf(material.id));
        const [v, l] = pairs.nearest([0, 0], [45, 120]);
        image.draw(await texels("image", { m: material.id, ...pairs.query(v, l) }));
        linked.show();
      } catch (error) {
        report(error);
      }
    });
  };
  return { root, show };
}

function enlarge(source: () => Material | undefined): Form {
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

function exchange(source: () => Material | undefined): Form {
  const other = materialChoice(t("reflectance"), ["btf", "compressed"], () => {});
  const shading = toggle(t("keep-shading"), true, () => {});
  other.root.addEventListener("pointerdown", () => other.refresh());
  other.root.addEventListener("focusin", () => other.refresh());
  return {
    root: h("div", { class: "fields" }, other.root, shading.root),
    kind: "exchange",
    suffix: "exchanged",
    request(name) {
      const structure = source();
      if (!structure || !other.get()) {
        report(new Error(t("choose-material")));
        return null;
      }
      return { structure: structure.id, reflectance: other.get(), shading: shading.get(), name };
    },
  };
}

function edit(source: () => Material | undefined): Form {
  const hue = slider({ min: -180, max: 180, step: 1, value: 0, unit: "°" }, () => {});
  const saturation = slider({ min: 0, max: 2, step: 0.01, value: 1 }, () => {});
  const gloss = slider({ min: 0.25, max: 4, step: 0.01, value: 1, log: true }, () => {});
  const highlights = slider({ min: 0, max: 3, step: 0.01, value: 1 }, () => {});
  const contrast = slider({ min: 0, max: 2, step: 0.01, value: 1 }, () => {});
  const exposure = slider({ min: -3, max: 3, step: 0.05, value: 0, unit: t("stops") }, () => {});
  const similar = slider({ min: 1, max: 60, step: 1, value: 10 }, () => {});
  const near = h("div", { class: "fields", hidden: true }, h("p", { class: "hint" }, t("pick-texel")), field(t("similar"), similar.root));
  const where = segmented([{ value: "all", label: t("everywhere") }, { value: "near", label: t("around-texel") }], "all", (value) => (near.hidden = value === "all"), t("where"));
  return {
    root: h(
      "div",
      { class: "fields" },
      ...([["hue", hue], ["saturation", saturation], ["gloss", gloss], ["highlights", highlights], ["contrast", contrast], ["exposure", exposure]] as const).map(([name, control]) => field(t(name), control.root)),
      field(t("where"), where.root),
      near,
    ),
    kind: "edit",
    suffix: "edited",
    request(name) {
      const material = source();
      const { x, y } = state.now;
      if (!material) return null;
      if (where.get() === "near" && (x === undefined || y === undefined)) {
        report(new Error(t("pick-texel")));
        return null;
      }
      return {
        material: material.id, hue: hue.get(), saturation: saturation.get(), gloss: gloss.get(), highlights: highlights.get(), contrast: contrast.get(), exposure: exposure.get(),
        grow: where.get() === "near" ? [x, y] : null, similar: similar.get(), name,
      };
    },
  };
}
