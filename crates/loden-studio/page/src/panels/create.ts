/** New materials: larger ones, exchanged ones, mixed ones, edited ones. */

import { Scrub, type Texels, texels } from "../api";
import { h } from "../dom";
import { bar, doing, jobs } from "../jobs";
import { type Details, type Job, type Material, model, stem } from "../model";
import { state, type State } from "../state";
import { t } from "../texts";
import { button, empty, field, line, report, segmented } from "../widgets";
import { go, materialChoice, only, type Panel } from "./common";
import { type Context, edit, enlarge, exchange, type Form, mix } from "./forms";
import { between, chosenTexel, cropped, follow, JobPictures, shown } from "./result";

const TASKS = ["enlarge", "exchange", "mix", "edit"] as const;
type Task = (typeof TASKS)[number];

/** Between the cells of the pictures that jobs show, and the side of a cell of a grid. */
const GAP = 4;
const CELL = 144;

const FINISHED = ["done", "failed", "cancelled"];

export function create(): Panel {
  const root = h("section", { class: "panel" });
  const none = empty(t("no-create"), t("no-create-text"), button(t("go-gallery"), () => go("gallery"), { kind: "primary" }));
  const reset = { x: undefined, y: undefined, c: undefined, try: undefined, rows: undefined, paint: undefined };
  const material = materialChoice(t("material"), ["btf", "compressed"], (m) => state.change({ m, ...reset }));
  const task = segmented(TASKS.map((value) => ({ value, label: t(value) })), "enlarge", (how) => state.change({ how, c: undefined, try: undefined, on: undefined }), t("create"));
  const text = h("p", { class: "hint" });
  const place = h("div");
  const before = shown(t("before"), "", false, (texel) => forms[current()].pick?.(texel), () => source && forms[current()].show?.(state.now, source));
  const after = shown(t("after"), t("result-here"), true);
  const trace = follow(after, before);
  const name = line("", () => (named = true));
  const progress = bar(t("create"));
  const what = h("span", { class: "doing" });
  const stop = button(t("cancel"), () => job !== null && void jobs.cancel(job));
  const running = h("div", { class: "running" }, progress.root, h("div", { class: "job-line" }, what), stop);
  const start = button(t("start"), () => begin(), { kind: "primary wide" });
  const maker = h("div", { class: "maker" }, place, h("div", { class: "fields" }, field(t("name"), name.root)), start, running);
  const side = h("aside", { class: "side" }, material.root, task.root, text, maker);
  const whole = h("div", { class: "columns two" }, side, h("div", { class: "main pair-view" }, before.root, after.root));
  const pictures = new JobPictures();
  const scrub = new Scrub();
  let named = false;
  let job: number | null = null;
  let source: Material | undefined;
  let details: Details | undefined;
  let tried: Texels | null = null;
  let asked = "";
  const context: Context = {
    source: () => source,
    details: () => details,
    image: before.image,
    try: (kind, request) => launch(kind, request, (started) => state.change({ try: started.id, c: undefined })),
  };
  const forms: Record<Task, Form> = { enlarge: enlarge(context), exchange: exchange(context), mix: mix(context), edit: edit(context) };
  const current = (): Task => TASKS.find((one) => one === state.now.how) ?? "enlarge";

  const suggest = () => {
    if (source && !named) name.set(model.freeName(`${stem(source.name)}-${forms[current()].suffix}`, "loden"));
  };
  const watch = (now: Job) => {
    progress.show(now);
    what.textContent = doing(now);
    const isTrial = now.kind === "grid" || now.kind === "steps";
    if (now.phase === "running" && !isTrial && state.now.panel === "create") pictures.show(now.id, now.pictures, (found) => job === now.id && after.live(found, t("grows")));
    if (!FINISHED.includes(now.phase)) return;
    job = null;
    maker.classList.remove("busy");
    if (isTrial || now.phase !== "done") return show(state.now);
    named = false;
    void model.refresh().then(() => {
      const made = model.listed.materials.find((one) => one.name === now.title);
      if (made && state.now.panel === "create") state.change({ c: made.id });
      suggest();
    }, report);
  };
  const launch = (kind: string, request: Record<string, unknown>, started: (job: Job) => void) => {
    maker.classList.add("busy");
    void jobs.start(kind, request, watch).then(
      (one) => {
        job = one.id;
        started(one);
        watch(one);
      },
      (error) => {
        maker.classList.remove("busy");
        report(error);
      },
    );
  };
  const begin = () => {
    const request = forms[current()].request(name.get());
    if (!request) return;
    launch(forms[current()].kind, request, () => {
      asked = "";
      after.material(undefined);
      state.change({ try: undefined, c: undefined });
    });
  };

  /** What a click on a cell of a grid chooses. */
  const pickCell = (texel: { x: number; y: number }) => {
    const ids = (state.now.more ?? "").split(" ");
    const [row, column] = [Math.floor(texel.y / (CELL + GAP)), Math.floor(texel.x / (CELL + GAP))];
    const [structure, reflectance] = [ids[row], ids[column]];
    if (structure && reflectance && row !== column) state.change({ m: structure, with: reflectance });
  };
  const showTrial = () => {
    if (!tried) return;
    if (current() === "exchange") return after.live(tried, t("grid-caption"), pickCell);
    const side = tried.height;
    const last = Math.round((tried.width + GAP) / (side + GAP)) - 1;
    const at = Math.min(1, Math.max(0, state.now.amt ?? 0.5)) * last;
    const frame = (k: number) => cropped(tried!, Math.min(k, last) * (side + GAP), 0, side, side);
    after.live(between(frame(Math.floor(at)), frame(Math.floor(at) + 1), at % 1), t("steps-caption"));
  };
  /** A trial that runs or ran on the server. */
  const showJob = (id: number) => {
    const found = jobs.list.find((one) => one.id === id);
    if (!found) return;
    const key = `${id} ${found.pictures}`;
    after.image.root.dataset.wanted = key;
    pictures.show(id, found.pictures, (one) => {
      tried = one;
      after.image.root.dataset.shown = key;
      if (state.now.try === id) showTrial();
    });
    showTrial();
  };
  /** What an edit would do, if that is known at once. */
  const preview = () => {
    const request = forms[current()].trial?.() ?? null;
    const key = request ? JSON.stringify(request) : "";
    if (!request) {
      asked = "";
      return after.material(undefined);
    }
    if (key === asked) return;
    asked = key;
    after.image.root.dataset.wanted = key;
    scrub.run(async () => {
      try {
        const found = await texels("preview", {}, request);
        if (asked !== key) return;
        after.live(found, t("preview"));
        after.image.root.dataset.shown = key;
      } catch (error) {
        if (asked === key) report(error);
      }
    });
  };
  const showAfter = (now: State) => {
    const made = model.material(now.c);
    trace(source, current() === "enlarge" ? made : undefined);
    if (now.try === undefined) {
      tried = null;
      pictures.forget();
    }
    if (made || now.try !== undefined) asked = "";
    if (made) after.material(made);
    else if (now.try !== undefined) showJob(now.try);
    // while a job runs, its pictures are shown
    else if (job === null) preview();
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
    text.textContent = t(`${current()}-text`);
    only(place, forms[current()].root);
    suggest();
    before.material(source);
    before.image.choose(current() === "edit" && now.on === "near" ? chosenTexel() : null);
    if (details?.id !== source.id) {
      details = undefined;
      const wanted = source.id;
      void model.detailsOf(wanted).then((found) => {
        if (source?.id !== wanted) return;
        details = found;
        if (state.now.panel === "create") show(state.now);
      }, report);
    }
    before.image.tool = null;
    if (!["mix", "edit"].includes(current()) || !["mask", "rows"].includes(now.on ?? "")) before.image.tint(null);
    forms[current()].show?.(now, source);
    showAfter(now);
  };
  jobs.onChange(() => {
    if (root.isConnected && state.now.panel === "create" && state.now.try !== undefined && state.now.c === undefined) showJob(state.now.try);
  });
  return { root, show };
}
