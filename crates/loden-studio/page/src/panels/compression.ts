/** What compression does: original, reconstruction and difference for any pair, and what each form costs. */

import { Scrub, texels, type Texels } from "../api";
import { chart } from "../chart";
import { Pairs, Pickers } from "../directions";
import { fill, h } from "../dom";
import { bar, doing, jobs } from "../jobs";
import { type Details, type Job, type Material, model, stem } from "../model";
import { form } from "../params";
import { partsView } from "../parts";
import { state, type State } from "../state";
import { bytes, number, seconds, t } from "../texts";
import { Linked, texture, type Texture, zoomer } from "../texture";
import { button, choice, empty, field, line, report, segmented, slider } from "../widgets";
import { go, materialChoice, only, type Panel } from "./common";

export function compression(): Panel {
  const root = h("section", { class: "panel" });
  const none = empty(t("no-compression"), t("no-compression-text"), button(t("go-gallery"), () => go("gallery"), { kind: "primary" }));
  const material = materialChoice(t("material"), ["btf"], (m) => state.change({ m, c: undefined }));
  const pickers = new Pickers();
  const images = comparison();
  const maker = compressor();
  const results = outcomes();
  const parts = partsView();
  const side = h("aside", { class: "side" }, material.root, h("div", { class: "pickers pair" }, pickers.light.root, pickers.view.root), maker.root);
  const whole = h("div", { class: "columns two" }, side, h("div", { class: "main stacked" }, images.root, results.root, parts.root));
  let pairs: Pairs | null = null;
  const show = (now: State) => {
    material.refresh();
    const source = original(now.m);
    if (!source) {
      only(root, none);
      return;
    }
    only(root, whole);
    material.set(source.id);
    const forms = model.formsOf(source);
    const shown = forms.find((one) => one.id === now.c) ?? forms.find((one) => one.id === now.m) ?? best(forms);
    maker.show(source);
    results.show(source, forms, shown);
    void model.detailsOf(source.id).then((details: Details) => {
      if (original(state.now.m)?.id !== source.id) return;
      if (pairs?.details !== details) pairs = new Pairs(details);
      pickers.show(pairs);
      const [v, l] = pickers.now();
      images.show(source, shown, pairs, v, l);
      parts.show(shown, pairs.query(v, l).view);
    }, report);
  };
  return { root, show };
}

/** The measurement of the state: itself, or what a compressed form was made from. */
function original(id: string | undefined): Material | undefined {
  const found = model.material(id);
  if (found?.holds === "btf") return found;
  if (found?.holds === "compressed") return model.of("btf").find((one) => one.name === found.source);
  return undefined;
}

function best(forms: Material[]): Material | undefined {
  return [...forms].sort((a, b) => (b.modified ?? 0) - (a.modified ?? 0))[0];
}

/** Three images of one pair that move together. */
function comparison() {
  const linked = new Linked();
  const [first, second, third] = (["original", "reconstruction", "difference"] as const).map((name) => texture(linked, t(name))) as [Texture, Texture, Texture];
  const captions = [h("figcaption", {}, h("strong", {}, t("original"))), h("figcaption"), h("figcaption")];
  const figures = [first, second, third].map((one, k) => h("figure", { class: "compare" }, one.root, captions[k]!));
  const handle = h("div", { class: "wipe-handle", role: "slider", tabindex: 0, "aria-label": t("wipe-handle"), "aria-valuemin": 0, "aria-valuemax": 100 });
  const grid = h("div", { class: "compare-grid" }, ...figures);
  const note = h("span", { class: "hint" });
  const mode = segmented(
    [
      { value: "side", label: t("side-by-side") },
      { value: "wipe", label: t("wipe") },
    ],
    "side",
    () => arrange(),
    t("compression"),
  );
  const root = h("div", { class: "viewer" }, h("header", { class: "bar-line" }, mode.root, h("span", { class: "grow" }), note, zoomer(linked)), grid);
  const scrub = new Scrub();
  let share = 0.5;
  let drawn = "";
  let named = "";

  const wipe = (next: number) => {
    share = Math.min(1, Math.max(0, next));
    handle.style.left = `${100 * share}%`;
    handle.setAttribute("aria-valuenow", String(Math.round(100 * share)));
    second.clip(mode.get() === "wipe" ? share : null);
  };
  const name = () => {
    const both = mode.get() === "wipe";
    fill(captions[0]!, h("strong", {}, both ? `${t("original")} | ${t("reconstruction")}` : t("original")), both && named ? ` ${named}` : "");
  };
  const arrange = () => {
    const isWipe = mode.get() === "wipe";
    name();
    grid.classList.toggle("wiping", isWipe);
    if (isWipe) {
      first.root.parentElement!.append(second.root, handle);
    } else {
      figures[1]!.prepend(second.root);
      handle.remove();
    }
    wipe(share);
    linked.show();
  };
  const toShare = (event: PointerEvent) => {
    const box = first.root.getBoundingClientRect();
    wipe((event.clientX - box.left) / box.width);
  };
  handle.addEventListener("pointerdown", (event) => {
    handle.setPointerCapture(event.pointerId);
    event.stopPropagation();
  });
  handle.addEventListener("pointermove", (event) => {
    if (handle.hasPointerCapture(event.pointerId)) toShare(event);
  });
  handle.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.key];
    if (!step) return;
    event.preventDefault();
    wipe(share + step);
  });
  const show = (source: Material, shown: Material | undefined, pairs: Pairs, v: number, l: number) => {
    const query = pairs.query(v, l);
    const key = `${source.id} ${shown?.id} ${shown?.modified} ${v} ${l}`;
    if (key === drawn) return;
    if (!drawn.startsWith(`${source.id} `)) linked.fit();
    drawn = key;
    grid.classList.toggle("alone", !shown);
    note.textContent = shown ? "" : t("choose-form");
    root.dataset.wanted = key;
    scrub.run(async () => {
      try {
        const nothing = Promise.resolve(null as Texels | null);
        const [a, b, c] = await Promise.all([
          texels("image", { m: source.id, ...query }),
          shown ? texels("image", { m: shown.id, ...query }) : nothing,
          shown ? texels("difference", { m: source.id, with: shown.id, ...query }) : nothing,
        ]);
        first.draw(a);
        second.draw(b);
        third.draw(c);
        named = shown?.name ?? "";
        name();
        fill(captions[1]!, h("strong", {}, t("reconstruction")), shown ? ` ${shown.name}` : "");
        fill(captions[2]!, h("strong", {}, t("difference")), c ? ` ${t("pair-error", { mean: number(c.mean), largest: number(c.largest) })}` : "");
        third.root.title = t("error-scale", { most: "1/8" });
        root.dataset.shown = key;
        linked.show();
      } catch (error) {
        report(error);
      }
    });
  };
  return { root, show };
}

/** The controls of a new compression. */
function compressor() {
  const goalPlace = h("div", { class: "fields" });
  const paramPlace = h("div");
  const doc = h("p", { class: "hint" });
  const root = h("div", { class: "maker" });
  const running = h("div", { class: "running" });
  const progress = bar(t("job-compress"));
  const what = h("span", { class: "doing" });
  const left = h("span", { class: "time" });
  let source: Material | undefined;
  let params = form([]);
  let job: number | null = null;
  let named = false;
  let dirty = true;

  const codecs = model.tables.codecs;
  let codec = codecs.find((one) => one.name === model.tables.codec) ?? codecs[0]!;
  const name = line("", () => (named = true));
  const suggest = () => {
    if (source && !named) name.set(model.freeName(`${stem(source.name)}-${codec.name}`, "loden"));
  };
  const method = choice(
    codecs.map((one) => ({ value: one.name, label: one.name, doc: one.doc })),
    codec.name,
    (value) => {
      codec = codecs.find((one) => one.name === value)!;
      take();
    },
  );
  const quality = slider({ min: 1, max: 100, step: 1, value: 60 }, () => {});
  const size = slider({ min: 1, max: 20000, step: 1, value: 200, unit: t("kilobytes"), log: true }, () => {});
  const levels = h("span", { class: "hint" });
  const most = slider({ min: 0.002, max: 0.1, step: 0.0005, value: 0.02, log: true, digits: 4 }, () => sayLevels());
  const sayLevels = () => (levels.textContent = t("grey-levels", { levels: number(255 * most.get(), 2) }));
  sayLevels();
  const goals = {
    none: [],
    quality: [field(t("goal-quality"), quality.root)],
    bytes: [field(t("goal-bytes"), size.root)],
    error: [field(t("goal-error"), most.root), levels],
  } as Record<string, HTMLElement[]>;
  const goal = segmented(
    (["none", "quality", "bytes", "error"] as const).map((value) => ({ value, label: t(`goal-${value}`), doc: t(`goal-${value}-doc`) })),
    "none",
    () => take(),
    t("goal"),
  );
  const request = () => {
    const aims = { none: null, quality: { quality: quality.get() }, bytes: { bytes: Math.round(1000 * size.get()) }, error: { "max-error": most.get() } };
    const chosen = aims[goal.get() as keyof typeof aims];
    return { material: source!.id, method: codec.name, params: params.get(), goal: chosen, name: name.get() };
  };
  const follow = (now: Job) => {
    progress.show(now);
    what.textContent = doing(now);
    left.textContent = now.remaining_s !== null ? t("left", { time: seconds(now.remaining_s) }) : "";
    if (["done", "failed", "cancelled"].includes(now.phase)) {
      job = null;
      root.classList.remove("busy");
      named = false;
      suggest();
      if (now.phase === "done") {
        void model.refresh().then(() => {
          const made = model.listed.materials.find((one) => one.name === now.title);
          if (made && state.now.panel === "compression") state.change({ c: made.id });
          suggest();
        }, report);
      }
    }
  };
  const start = button(
    t("compress"),
    () => {
      if (!source || !params.ok()) return;
      void jobs.start("compress", request(), follow).then((started) => {
        job = started.id;
        root.classList.add("busy");
        follow(started);
      }, report);
    },
    { kind: "primary wide" },
  );
  const stop = button(t("cancel"), () => job !== null && void jobs.cancel(job));
  fill(running, progress.root, h("div", { class: "job-line" }, what, left), stop);
  const take = () => {
    doc.textContent = codec.doc;
    const searches = goal.get() !== "none";
    if (dirty || method.get() !== root.dataset.method) {
      params = form(codec.params);
      fill(paramPlace, h("details", searches ? {} : { open: true }, h("summary", {}, t("parameters")), params.root));
      root.dataset.method = method.get();
      dirty = false;
    }
    if (!searches) paramPlace.querySelector("details")!.open = true;
    fill(goalPlace, ...goals[goal.get()]!);
    suggest();
  };
  take();
  fill(root, h("div", { class: "fields" }, field(t("method"), method.root), doc, field(t("goal"), goal.root)), goalPlace, paramPlace, h("div", { class: "fields" }, field(t("name"), name.root)), start, running);
  return {
    root,
    show(now: Material) {
      if (source?.id !== now.id) {
        source = now;
        named = false;
      }
      suggest();
    },
  };
}

/** The chart and the list of all forms. */
function outcomes() {
  const select = (c: string) => state.change({ c });
  const plot = chart(select);
  const title = h("h2", { class: "sub" });
  const text = h("p", { class: "hint" });
  const rows = h("tbody");
  const table = h("table", { class: "forms" }, h("thead", {}, h("tr", {}, ...[t("name"), t("method"), t("fact-bytes"), t("fact-error"), t("open")].map((name) => h("th", { scope: "col" }, name)))), rows);
  const filled = h("div", { class: "outcome-grid" }, h("div", {}, title, text, plot.root), h("div", { class: "scroll" }, table));
  const root = h("section", { class: "outcomes" });
  const show = (source: Material, forms: Material[], shown: Material | undefined) => {
    if (forms.length === 0) {
      fill(root, empty(t("chart-empty"), t("chart-empty-text", { name: source.name })));
      return;
    }
    title.textContent = t("chart");
    text.textContent = t("chart-text", { name: source.name });
    plot.show(forms, shown?.id);
    fill(
      rows,
      ...[...forms]
        .sort((a, b) => a.bytes - b.bytes)
        .map((one) =>
          h(
            "tr",
            { class: one.id === shown?.id ? "chosen" : "", onclick: () => select(one.id) },
            h("td", {}, h("button", { type: "button", class: "link", onclick: () => select(one.id) }, one.name)),
            h("td", {}, one.method ?? ""),
            h("td", { class: "right" }, bytes(one.bytes)),
            h("td", { class: "right" }, one.error ? number(one.error) : "–"),
            h("td", { class: "right" }, h("button", { type: "button", class: "link", onclick: () => go("view", { m: one.id }) }, t("view"))),
          ),
        ),
    );
    only(root, filled);
  };
  return { root, show };
}
