/** Controls made from a table of parameters. */

import { h } from "./dom";
import type { Param } from "./model";
import { t } from "./texts";
import { choice, type Control, field, line, segmented, slider, toggle } from "./widgets";

/** A form. What differs from the default is given as text by name, as on the command line. */
export function form(table: Param[]): { root: HTMLElement; get(): Record<string, string>; ok(): boolean } {
  const given = new Map<string, string>();
  const wrong = new Set<string>();
  const set = (param: Param, text: string) => {
    if (text === param.default || (text.trim() === "" && !param.default)) given.delete(param.name);
    else given.set(param.name, text);
  };
  const controls = table.map((param) => field(`${param.name}${param.unit ? `, ${param.unit}` : ""}`, control(param, set, wrong), param.doc));
  return {
    root: h("div", { class: "fields" }, ...controls),
    get: () => Object.fromEntries(given),
    ok: () => wrong.size === 0,
  };
}

function control(param: Param, set: (param: Param, text: string) => void, wrong: Set<string>): HTMLElement {
  if (param.kind === "switch") return toggle(param.name, param.default === "yes", (on) => set(param, on ? "yes" : "no")).root;
  if (param.kind === "choice") {
    const words = (param.range as string[]).map((word) => ({ value: word, label: word }));
    const room = words.reduce((sum, word) => sum + word.label.length + 2, 0);
    const take = (word: string) => set(param, word);
    return words.length <= 4 && room < 34 && param.default ? segmented(words, param.default, take).root : choice(words, param.default, take, t("default-value")).root;
  }
  const [min, max] = param.kind === "integer" || param.kind === "real" ? (param.range as [number, number]) : [0, 0];
  // a slider where its steps are fine enough
  if (param.kind === "integer" && param.default && max - min <= 100) {
    return slider({ min, max, step: 1, value: Number(param.default) }, (value) => set(param, String(value))).root;
  }
  if (param.kind === "real" && param.default && max - min <= 10 && max > min) {
    return slider({ min, max, step: 0.01, value: Number(param.default) }, (value) => set(param, String(Number(value.toFixed(4))))).root;
  }
  const hint = param.default || t("default-value");
  const input: Control<string> = line(param.default, (text) => {
    const number = Number(text);
    const bad = (param.kind === "integer" || param.kind === "real") && text.trim() !== "" && !(number >= min && number <= max && (param.kind === "real" || Number.isInteger(number)));
    if (bad) wrong.add(param.name);
    else wrong.delete(param.name);
    input.root.setAttribute("aria-invalid", String(bad));
    if (!bad) set(param, text);
  }, hint);
  return input.root;
}
