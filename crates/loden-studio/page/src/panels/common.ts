/** What panels share. */

import { fill, h } from "../dom";
import { type Details, type Material, model } from "../model";
import { state, type State } from "../state";
import { bytes, type Key, number, t } from "../texts";
import { choice, type Control, field, type Option } from "../widgets";

export interface Panel {
  root: HTMLElement;
  /** Shows the state; called whenever it or the list of materials changes. */
  show(state: State): void;
}

export function optionOf(material: Material): Option {
  return { value: material.id, label: material.name, doc: summary(material) };
}

/** A material in a line. */
export function summary(material: Material): string {
  const parts = [kindOf(material)];
  if (material.width) parts.push(t("images-of", { width: material.width, height: material.height ?? 0, pairs: material.pairs ?? 0 }));
  parts.push(bytes(material.bytes));
  if (material.error) parts.push(t("error-of", { error: number(material.error) }));
  return parts.join(" · ");
}

export function kindOf(material: Material): string {
  if (material.problem) return t("kind-problem");
  if (material.holds === "compressed") return material.method ?? t("kind-compressed");
  return t(`kind-${material.holds ?? "btf"}` as Key);
}

/** Chooses one of some materials. */
export function materialChoice(label: string, kinds: string[], change: (id: string) => void): Control<string> & { root: HTMLElement; refresh(): void } {
  const control = choice([], "", change, t("choose-material"));
  return {
    root: field(label, control.root),
    get: control.get,
    set: control.set,
    refresh: () => control.offer(model.of(...kinds).map(optionOf)),
  };
}

/** A list of names and values. */
export function facts(rows: [string, string | number | null | undefined][]): HTMLElement {
  const list = h("dl", { class: "facts" });
  for (const [name, value] of rows) if (value !== null && value !== undefined && value !== "") list.append(h("dt", {}, name), h("dd", {}, value));
  return list;
}

export function factsOf(details: Details): HTMLElement {
  return facts([
    [t("fact-kind"), details.kind],
    [t("fact-size"), details.width ? `${details.width} × ${details.height}` : null],
    [t("fact-directions"), details.views && !details.listed ? `${details.views} × ${details.lights}` : null],
    [t("fact-images"), details.pairs],
    [t("fact-missing"), details.missing?.length || null],
    [t("fact-encoding"), details.encoding],
    [t("fact-cosine"), details.cosine],
    [t("fact-bytes"), bytes(details.bytes)],
    [t("fact-source"), details.source],
    [t("fact-method"), details.method],
    [t("fact-error"), details.report ? number(details.report.mean_abs_error) : null],
    [t("fact-psnr"), details.report?.psnr_db ? `${number(details.report.psnr_db)} dB` : null],
    [t("fact-ssim"), details.report ? number(details.report.ssim, 4) : null],
    ...Object.entries(details.facts ?? {}).filter(([name]) => !name.startsWith("why_")).slice(0, 12).map(([name, value]): [string, string] => [name.replaceAll("_", " "), value]),
  ]);
}

/** Shows one of several things in a place. */
export function only(place: Element, thing: Element): void {
  if (place.firstElementChild !== thing || place.children.length !== 1) fill(place, thing);
}

export function go(panel: string, part: Partial<State> = {}): void {
  state.change({ ...part, panel });
}

/** Begins a download without leaving the page. */
export function save(href: string, name = ""): void {
  const link = h("a", { href, download: name });
  document.body.append(link);
  link.click();
  link.remove();
}
