/** All materials, as cards. */

import { address, upload } from "../api";
import { fill, h, icon } from "../dom";
import { jobs } from "../jobs";
import { type Material, model } from "../model";
import { form } from "../params";
import { state, type State } from "../state";
import { bytes, number, t } from "../texts";
import { button, choice, dialog, empty, field, line, report, segmented, slider, toast } from "../widgets";
import { go, kindOf, type Panel } from "./common";

const ORDERS: Record<string, (a: Material, b: Material) => number> = {
  name: (a, b) => a.name.localeCompare(b.name),
  kind: (a, b) => kindOf(a).localeCompare(kindOf(b)) || a.name.localeCompare(b.name),
  size: (a, b) => b.bytes - a.bytes,
  new: (a, b) => (b.modified ?? 0) - (a.modified ?? 0),
};

export function gallery(): Panel {
  const search = line("", (q) => state.change({ q: q || undefined }, "quiet"), t("search"));
  search.root.setAttribute("aria-label", t("search"));
  search.root.setAttribute("type", "search");
  search.root.id = "search";
  const order = segmented(
    (["name", "kind", "size", "new"] as const).map((value) => ({ value, label: t(`sort-${value}`) })),
    "name",
    (by) => state.change({ by: by === "name" ? undefined : by }, "quiet"),
    t("sort"),
  );
  const file = h("input", { type: "file", hidden: true, multiple: true });
  file.addEventListener("change", () => {
    void add([...(file.files ?? [])]);
    file.value = "";
  });
  const count = h("span", { class: "hint" });
  const head = h(
    "header",
    { class: "bar-line gallery-head" },
    search.root,
    order.root,
    count,
    h("span", { class: "grow" }),
    button(t("choose-file"), () => file.click(), { icon: "plus" }),
    button(t("make-sample"), makeSample, { kind: "primary" }),
    file,
  );
  const grid = h("div", { class: "cards" });
  const place = h("div", { class: "gallery-place" });
  const root = h("section", { class: "panel gallery" }, head, place);
  let shown = "";
  const show = (now: State) => {
    if (search.get() !== (now.q ?? "")) search.set(now.q ?? "");
    order.set(now.by ?? "name");
    if (!model.loaded) {
      fill(place, h("p", { class: "hint center" }, t("loading")));
      return;
    }
    const words = (now.q ?? "").toLowerCase().split(/\s+/).filter(Boolean);
    const text = (one: Material) => `${one.name} ${kindOf(one)} ${one.kind ?? ""} ${one.method ?? ""}`.toLowerCase();
    const found = model.listed.materials.filter((one) => words.every((word) => text(one).includes(word)));
    found.sort(ORDERS[now.by ?? "name"] ?? ORDERS.name);
    const key = JSON.stringify([found, now.q]);
    if (key === shown && place.firstElementChild) return;
    shown = key;
    count.textContent = String(found.length);
    if (model.listed.materials.length === 0) {
      fill(place, empty(t("no-materials"), t("no-materials-text"), button(t("make-sample"), makeSample, { kind: "primary" }), button(t("choose-file"), () => file.click())));
    } else if (found.length === 0) {
      fill(place, empty(t("nothing-found", { query: now.q ?? "" }), t("nothing-found-text"), button(t("clear-search"), () => state.change({ q: undefined }))));
    } else {
      fill(grid, ...found.map(card));
      fill(place, grid);
    }
  };
  drop(root);
  return { root, show };
}

function card(material: Material): HTMLElement {
  const picture = material.problem
    ? h("div", { class: "thumb broken" }, icon("warning"))
    : h("img", { class: "thumb", src: address("thumbnail", { m: material.id, t: material.modified ?? 0 }), alt: "", loading: "lazy", width: 256, height: 256 });
  const details = material.problem
    ? h("span", { class: "bad" }, material.problem)
    : h("span", { class: "hint" }, material.width ? t("images-of", { width: material.width, height: material.height ?? 0, pairs: material.pairs ?? 0 }) : (material.kind ?? ""));
  const open = () => (material.problem ? dialog(t("cannot-read"), h("p", {}, material.problem)) : go("originals", { m: material.id, x: undefined, y: undefined }));
  return h(
    "button",
    { type: "button", class: "card", onclick: open, "data-id": material.id },
    picture,
    h(
      "span",
      { class: "card-text" },
      h("strong", {}, material.name),
      details,
      h(
        "span",
        { class: "card-line" },
        h("span", { class: `chip ${material.problem ? "bad" : (material.holds ?? "")}` }, kindOf(material)),
        h("span", {}, bytes(material.bytes)),
        material.error ? h("span", { class: "hint" }, t("error-of", { error: number(material.error) })) : null,
      ),
    ),
  );
}

/** Uploads files one after the other. */
async function add(files: File[]): Promise<void> {
  for (const file of files) {
    const text = h("span", {}, t("uploading", { name: file.name, share: 0 }));
    const inner = h("div", { class: "bar-inner" });
    const box = h("div", { class: "toast upload" }, text, h("div", { class: "bar running" }, inner));
    document.querySelector(".toasts")?.append(box);
    try {
      const { kind } = await upload(file, (share) => {
        inner.style.width = `${100 * share}%`;
        text.textContent = t("uploading", { name: file.name, share: Math.round(100 * share) });
      });
      toast(t(kind === "mesh" ? "added-mesh" : kind === "panorama" ? "added-panorama" : "added", { name: file.name }));
    } catch (error) {
      report(error);
    }
    box.remove();
    await model.refresh().catch(report);
  }
}

/** Takes files that are dropped anywhere on the page. */
function drop(root: HTMLElement): void {
  const veil = h("div", { class: "veil", hidden: true }, h("p", {}, ""));
  document.body.append(veil);
  let inside = 0;
  const hasFiles = (event: DragEvent) => event.dataTransfer?.types.includes("Files") ?? false;
  addEventListener("dragenter", (event) => {
    if (!hasFiles(event)) return;
    inside += 1;
    veil.firstElementChild!.textContent = t("drop-here", { folder: model.listed.output });
    veil.hidden = false;
  });
  addEventListener("dragleave", () => {
    inside = Math.max(0, inside - 1);
    if (inside === 0) veil.hidden = true;
  });
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    inside = 0;
    veil.hidden = true;
    const files = [...(event.dataTransfer?.files ?? [])];
    if (files.length) {
      if (!root.isConnected) go("gallery");
      void add(files);
    }
  });
}

/** The virtual goniometer as a form. */
export function makeSample(): void {
  const samples = model.tables.samples;
  const place = h("div");
  let params = form([]);
  let sample = samples.find((one) => one.name === "twill") ?? samples[0]!;
  let named = false;
  const name = line("", () => (named = true));
  const suggest = () => {
    if (!named) name.set(model.freeName(sample.name, "zip"));
  };
  const take = (value: string) => {
    sample = samples.find((one) => one.name === value)!;
    params = form(sample.params);
    fill(place, h("details", {}, h("summary", {}, t("parameters")), params.root));
    doc.textContent = sample.doc;
    suggest();
  };
  const doc = h("p", { class: "hint" });
  const kind = choice(samples.map((one) => ({ value: one.name, label: one.name, doc: one.doc })), sample.name, take);
  const size = segmented(["32", "64", "128", "256"].map((value) => ({ value, label: value })), "64", () => {}, t("texels-per-side"));
  const spp = slider({ min: 1, max: 256, step: 1, value: 16, log: true }, () => {});
  const seed = slider({ min: 0, max: 99, step: 1, value: 0 }, () => {});
  take(sample.name);
  const start = button(
    t("start"),
    () => {
      if (!params.ok()) return;
      const request = { sample: sample.name, params: params.get(), size: Number(size.get()), spp: spp.get(), seed: seed.get(), name: name.get() };
      void jobs.start("acquire", request).then(window_.close, report);
    },
    { kind: "primary" },
  );
  const window_ = dialog(
    t("make-sample"),
    h("p", { class: "hint" }, t("sample-text")),
    h("div", { class: "fields" }, field(t("sample"), kind.root), doc, field(t("texels-per-side"), size.root), field(t("paths"), spp.root), field(t("seed"), seed.root)),
    place,
    h("div", { class: "fields" }, field(t("name"), name.root, t("writes-to", { folder: model.listed.output }))),
    h("div", { class: "row end" }, start),
  );
}
