/** The words of the page in the chosen language. */

import { de } from "./de";
import { en } from "./en";

const LANGUAGES = { en, de } as const;
export type Language = keyof typeof LANGUAGES;
export type Key = keyof typeof en;

const stored = localStorage.getItem("language");
const preferred = navigator.language.startsWith("de") ? "de" : "en";
export const language: Language = stored === "de" || stored === "en" ? stored : preferred;
document.documentElement.lang = language;

export function choose(next: Language): void {
  localStorage.setItem("language", next);
  location.reload();
}

/** A text with its {places} filled. */
export function t(key: Key, values: Record<string, string | number> = {}): string {
  return LANGUAGES[language][key].replace(/\{(\w+)\}/g, (_, name: string) => String(values[name] ?? ""));
}

/** A number with a few digits, as the language writes it. */
export function number(value: number, digits = 3): string {
  return value.toLocaleString(language, { maximumSignificantDigits: digits, useGrouping: false });
}

/** A size, in powers of 1000. */
export function bytes(value: number): string {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let k = 0;
  let size = value;
  while (size >= 999.5 && k < units.length - 1) {
    size /= 1000;
    k += 1;
  }
  return `${number(size, size >= 100 ? 3 : 2)} ${units[k]}`;
}

export function seconds(value: number): string {
  if (value < 60) return `${Math.max(1, Math.round(value))} s`;
  if (value < 3600) return `${Math.floor(value / 60)} min ${String(Math.round(value % 60)).padStart(2, "0")} s`;
  return `${Math.floor(value / 3600)} h ${Math.round((value % 3600) / 60)} min`;
}
