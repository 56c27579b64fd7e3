/** Images as they were measured: for each pair of directions, texel by texel. */

import { address, get, Scrub, texels } from "../api";
import { Pairs, Pickers } from "../directions";
import { fill, h, icon, s } from "../dom";
import { hemisphere } from "../hemisphere";
import { lobes } from "../lobe";
import { type Details, model } from "../model";
import { state, type State } from "../state";
import { type Key, number, t } from "../texts";
import { Linked, type Pointed, texture, zoomer } from "../texture";
import { button, copy, empty, report, segmented, toggle } from "../widgets";
import { factsOf, go, materialChoice, only, type Panel } from "./common";

interface TexelValues {
  value: [number, number, number];
  lights: number[];
  values: [number, number, number][];
  shown: [number, number, number][];
}

/** Texels that are compared with the chosen one, at most. */
const PINS = 6;

function pinsOf(now: State): Pointed[] {
  const pairs = (now.pins ?? "").split(" ").map((text) => text.split(",").map(Number));
  return pairs.flatMap(([x, y, ...rest]) => (rest.length === 0 && Number.isInteger(x) && Number.isInteger(y) && x! >= 0 && y! >= 0 ? [{ x: x!, y: y! }] : [])).slice(0, PINS);
}

function writePins(pins: Pointed[]): string | undefined {
  return pins.map(({ x, y }) => `${x},${y}`).join(" ") || undefined;
}

const PLOTS = ["polar", "spheres", "albedo", "slice", "hemisphere"] as const;

export function originals(): Panel {
  const root = h("section", { class: "panel" });
  const none = empty(t("no-originals"), t("no-originals-text"), button(t("go-gallery"), () => go("gallery"), { kind: "primary" }));
  const material = materialChoice(t("material"), ["btf", "compressed", "brdf"], (m) => state.change({ m, x: undefined, y: undefined }));
  const about = h("div", { class: "about" });
  const images = imagesView();
  const plots = plotsView();
  const side = h("aside", { class: "side" }, material.root, images.pickers, about);
  const main = h("div", { class: "main" });
  const whole = h("div", { class: "columns three" }, side, main, images.right);
  let shown: Details | null = null;
  const show = (now: State) => {
    material.refresh();
    material.set(now.m ?? "");
    if (!now.m || (model.loaded && !model.material(now.m)?.holds)) {
      shown = null;
      only(root, none);
      return;
    }
    only(root, whole);
    void model.detailsOf(now.m).then((details) => {
      if (state.now.m !== details.id) return;
      if (shown !== details) {
        shown = details;
        fill(about, h("h2", { class: "sub" }, t("facts")), factsOf(details), ...warnings(details));
      }
      const isBrdf = details.holds === "brdf";
      whole.classList.toggle("plots-only", isBrdf);
      images.pickers.hidden = images.right.hidden = isBrdf;
      only(main, isBrdf ? plots.root : images.root);
      if (isBrdf) plots.show(details);
      else images.show(details);
    }, report);
  };
  return { root, show };
}

function warnings(details: Details): HTMLElement[] {
  if (details.warnings.length === 0) return [];
  return [h("h2", { class: "sub" }, t("warnings-title")), ...details.warnings.map((warning) => h("p", { class: "warning" }, icon("warning"), warning))];
}

function imagesView() {
  const pickers = new Pickers();
  const linked = new Linked();
  const image = texture(linked, t("image"), ({ x, y }) => state.change({ x, y }));
  const note = h("p", { class: "note", role: "status" });
  const how = segmented(
    [
      { value: "", label: t("measured"), doc: t("measured-doc") },
      { value: "between", label: t("between"), doc: t("between-doc") },
    ],
    "",
    (value) => {
      const { view, light } = pickers.between();
      state.change(value ? { how: value, va: view.join(), la: light.join() } : { how: undefined, va: undefined, la: undefined });
    },
    t("image"),
  );
  const command = button("", () => void copy(commandLine()), { kind: "quiet", icon: "copy", title: t("copy-command") });
  const root = h("div", { class: "viewer" }, h("header", { class: "bar-line" }, how.root, h("span", { class: "grow" }), note, zoomer(linked), command), image.root);
  const scrub = new Scrub();
  const values = texelView();
  let pairs: Pairs | null = null;
  let drawn = "";
  let file = "";

  const commandLine = () => {
    if (!pairs) return "";
    const [v, l] = pickers.now();
    const { view, light } = state.now.how === "between" ? pickers.between() : { view: pairs.views[v]!, light: pairs.angles(l) };
    return `loden decompress ${file} --light ${light.join()} --view ${view.join()} -o image.png`;
  };
  const show = (details: Details) => {
    file = details.name;
    if (pairs?.details !== details) {
      pairs = new Pairs(details);
      if (!drawn.startsWith(`${details.id} `)) linked.fit();
    }
    pickers.show(pairs);
    how.set(state.now.how === "between" ? "between" : "");
    const [v, l] = pickers.now();
    const between = state.now.how === "between";
    note.textContent = !between && pairs.isMissing(v, l) ? t("no-pair") : "";
    const { x, y } = state.now;
    const texel = x !== undefined && y !== undefined && x < (details.width ?? 0) && y < (details.height ?? 0) ? { x, y } : null;
    image.choose(texel);
    image.mark(pinsOf(state.now));
    const query = pairs.query(v, l);
    const { view, light } = pickers.between();
    const key = `${details.id} ${between ? `${view} ${light}` : `${v} ${l}`}`;
    if (key !== drawn) {
      drawn = key;
      image.root.dataset.wanted = key;
      scrub.run(async () => {
        try {
          const found = between ? await texels("between", { m: details.id, view: view.join(), light: light.join() }) : await texels("image", { m: details.id, ...query });
          image.draw(found);
          image.root.dataset.shown = key;
          linked.show();
        } catch (error) {
          report(error);
        }
      });
    }
    values.show(details, pairs, texel, v, l);
  };
  return { root, show, pickers: h("div", { class: "pickers" }, pickers.light.root, pickers.view.root), right: values.root };
}

/** The values of one texel under all lights of a view. */
function texelView() {
  const title = h("h2", { class: "sub" });
  const numbers = h("p", { class: "numbers" });
  const dome = hemisphere(t("under-lights"), (index) => state.change({ l: now?.lights[index] }));
  const keep = button(t("pin"), () => pin(), { icon: "plus" });
  const pins = h("div", { class: "pins" });
  const plot = s("svg", { viewBox: "0 0 260 150", class: "slice", role: "img", "aria-label": t("polar-slice") });
  const body = h("div", { class: "texel-body" }, title, numbers, dome.root, h("div", { class: "label" }, t("polar-slice")), plot, keep, pins);
  const hint = h("p", { class: "hint boxed" }, t("texel-hint"));
  const root = h("aside", { class: "side right" }, hint);
  const scrub = new Scrub();
  let now: TexelValues | null = null;
  let more: TexelValues[] = [];
  let asked = "";

  const pin = () => {
    const { x, y } = state.now;
    if (x !== undefined && y !== undefined) state.change({ pins: writePins([...pinsOf(state.now), { x, y }]) });
  };
  const showPins = (kept: Pointed[]) => {
    const { x, y } = state.now;
    keep.disabled = kept.length >= PINS || kept.some((one) => one.x === x && one.y === y);
    const remove = (k: number) => state.change({ pins: writePins(kept.filter((_, at) => at !== k)) });
    const rows = kept.map(({ x, y }, k) =>
      h("div", { class: `pin series s${k % 6}` }, h("span", { class: "dot" }), h("span", {}, t("texel-at", { x, y })), h("span", { class: "grow" }), button("", () => remove(k), { kind: "quiet", icon: "close", title: t("unpin", { x, y }) })),
    );
    fill(pins, kept.length ? h("div", { class: "label" }, t("pinned")) : null, ...rows);
  };
  const luminance = ([r, g, b]: [number, number, number]) => 0.2126 * r + 0.7152 * g + 0.0722 * b;
  const draw = (pairs: Pairs, light: number) => {
    if (!now) return;
    const directions = now.lights.map((k) => pairs.angles(k));
    dome.offer(directions, new Set());
    dome.color(now.shown.map(([r, g, b]) => `rgb(${r} ${g} ${b})`));
    dome.choose(now.lights.indexOf(light));
    const luminances = now.values.map(luminance);
    const most = Math.max(...luminances, ...more.flatMap((one) => one.values.map(luminance)), 1e-6);
    const x = (theta: number) => 30 + (214 * theta) / 90;
    const y = (value: number) => 124 - (112 * value) / most;
    fill(
      plot,
      ...[0, 30, 60, 90].flatMap((theta) => [
        s("line", { class: "grid", x1: x(theta), x2: x(theta), y1: 12, y2: 124 }),
        s("text", { x: x(theta), y: 140, "text-anchor": "middle" }, `${theta}°`),
      ]),
      ...[0, most / 2, most].flatMap((value) => [
        s("line", { class: "grid", x1: 30, x2: 244, y1: y(value), y2: y(value) }),
        s("text", { x: 26, y: y(value) + 4, "text-anchor": "end" }, number(value, 2)),
      ]),
      ...more.map((one, at) =>
        s("g", { class: `series s${at % 6}` }, ...one.values.map((value, k) => s("circle", { cx: x(pairs.angles(one.lights[k]!)[0]), cy: y(luminance(value)), r: 2, class: "kept" }))),
      ),
      ...luminances.map((value, k) => s("circle", { cx: x(directions[k]![0]), cy: y(value), r: now!.lights[k] === light ? 4.5 : 2.4, class: now!.lights[k] === light ? "here" : "dot" })),
    );
  };
  const show = (details: Details, pairs: Pairs, texel: { x: number; y: number } | null, v: number, l: number) => {
    only(root, texel ? body : hint);
    if (!texel) {
      asked = "";
      return;
    }
    title.textContent = t("texel-at", { x: texel.x, y: texel.y });
    const kept = pinsOf(state.now).filter((one) => one.x < (details.width ?? 0) && one.y < (details.height ?? 0));
    showPins(kept);
    const key = `${details.id} ${texel.x} ${texel.y} ${v} ${l} ${writePins(kept)}`;
    if (key === asked) return;
    asked = key;
    scrub.run(async () => {
      try {
        const all = await Promise.all([texel, ...kept].map((one) => get<TexelValues>("texel", { m: details.id, ...pairs.query(v, l), x: one.x, y: one.y })));
        [now, more] = [all[0]!, all.slice(1)];
        numbers.textContent = `${now.value.map((value) => value.toFixed(4)).join("  ")}`;
        numbers.title = t("stored-values");
        draw(pairs, l);
      } catch (error) {
        report(error);
      }
    });
  };
  return { root, show };
}

/** The plots that people know of BRDFs, several materials in each. */
function plotsView() {
  const others = h("div", { class: "row wrap" });
  const space = lobes();
  const grid = h("div", { class: "plots", tabindex: 0, role: "group", "aria-label": t("originals") });
  const root = h("div", { class: "viewer" }, h("header", { class: "bar-line" }, h("span", { class: "label" }, t("overlay")), others), grid);
  const chosen = new Set<string>();
  let shown = "";
  const show = (details: Details) => {
    const choices = model.of("brdf").filter((other) => other.id !== details.id);
    for (const id of chosen) if (!choices.some((other) => other.id === id)) chosen.delete(id);
    const ids = [details.id, ...[...chosen].sort()];
    const key = `${ids} ${choices.map((other) => other.id)}`;
    if (key === shown) return;
    shown = key;
    fill(
      others,
      ...choices.slice(0, 12).map(
        (other) =>
          toggle(other.name, chosen.has(other.id), (on) => {
            if (on) chosen.add(other.id);
            else chosen.delete(other.id);
            show(details);
          }).root,
      ),
      choices.length ? null : h("span", { class: "hint" }, "–"),
    );
    space.show(ids.slice(0, 6));
    fill(
      grid,
      space.root,
      ...PLOTS.map((plot) =>
        h(
          "figure",
          { class: `plot ${plot}` },
          h("img", { src: address(`plot/${plot}`, { m: plot === "hemisphere" ? [details.id] : ids.slice(0, 6) }), alt: t(`plot-${plot}-doc` as Key) }),
          h("figcaption", {}, h("strong", {}, t(`plot-${plot}` as Key)), ` ${t(`plot-${plot}-doc` as Key)}`),
        ),
      ),
    );
  };
  return { root, show };
}
