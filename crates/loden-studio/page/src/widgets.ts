/** Controls that look alike on every system, and work by keyboard and for screen readers. */

import { type Child, fill, h, icon } from "./dom";
import { t } from "./texts";

export interface Option {
  value: string;
  label: string;
  doc?: string | undefined;
}

export interface Control<T> {
  root: HTMLElement;
  get(): T;
  set(value: T): void;
}

let numbers = 0;
function newId(): string {
  numbers += 1;
  return `w${numbers}`;
}

/** A label above a control. */
export function field(label: string, control: HTMLElement, hint?: string): HTMLElement {
  const id = newId();
  control.setAttribute("aria-labelledby", id);
  return h("div", { class: "field" }, h("span", { class: "label", id }, label), control, hint ? h("span", { class: "hint" }, hint) : null);
}

export function button(label: string, act: () => void, options: { kind?: string; icon?: string; title?: string } = {}): HTMLButtonElement {
  const only = label === "";
  return h(
    "button",
    { type: "button", class: `button ${options.kind ?? ""} ${only ? "only" : ""}`, onclick: act, title: options.title, "aria-label": only ? options.title : undefined },
    options.icon ? icon(options.icon) : null,
    label,
  );
}

/** One of a few: a row of buttons. */
export function segmented(options: Option[], value: string, change: (value: string) => void, label?: string): Control<string> {
  let now = value;
  const root = h("div", { class: "segmented", role: "radiogroup", "aria-label": label });
  const buttons = options.map((option) =>
    h("button", { type: "button", role: "radio", title: option.doc, onclick: () => choose(option.value) }, option.label),
  );
  const show = () =>
    buttons.forEach((one, k) => {
      const chosen = options[k]!.value === now;
      one.setAttribute("aria-checked", String(chosen));
      one.tabIndex = chosen || (k === 0 && !options.some((option) => option.value === now)) ? 0 : -1;
    });
  const choose = (next: string) => {
    if (next === now) return;
    now = next;
    show();
    change(next);
  };
  root.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    const at = options.findIndex((option) => option.value === now);
    const to = (at + step + options.length) % options.length;
    choose(options[to]!.value);
    buttons[to]!.focus();
  });
  root.append(...buttons);
  show();
  return {
    root,
    get: () => now,
    set(next) {
      now = next;
      show();
    },
  };
}

/** One of many: a button that opens a list with explanations. */
export function choice(options: Option[], value: string, change: (value: string) => void, empty = "–"): Control<string> & { offer(options: Option[]): void } {
  let now = value;
  let offered = options;
  let at = 0;
  const text = h("span", { class: "choice-text" });
  const opener = h("button", { type: "button", class: "choice", "aria-haspopup": "listbox", "aria-expanded": "false" }, text, icon("chevron"));
  const list = h("div", { class: "popup", role: "listbox", tabindex: "-1" });
  const root = h("div", { class: "choice-root" }, opener, list);
  const isOpen = () => root.classList.contains("open");
  const show = () => {
    const found = offered.find((option) => option.value === now);
    text.textContent = found?.label ?? empty;
    text.classList.toggle("empty", !found);
  };
  const mark = () => {
    [...list.children].forEach((child, k) => child.classList.toggle("at", k === at));
    list.children[at]?.scrollIntoView({ block: "nearest" });
    list.setAttribute("aria-activedescendant", list.children[at]?.id ?? "");
  };
  const close = (focus: boolean) => {
    root.classList.remove("open");
    opener.setAttribute("aria-expanded", "false");
    if (focus) opener.focus();
  };
  const take = (next: string) => {
    close(true);
    if (next === now) return;
    now = next;
    show();
    change(next);
  };
  const open = () => {
    fill(
      list,
      ...offered.map((option) =>
        h(
          "div",
          { class: "option", role: "option", id: newId(), "aria-selected": option.value === now, onclick: () => take(option.value) },
          h("span", {}, option.label),
          option.doc ? h("span", { class: "hint" }, option.doc) : null,
        ),
      ),
      offered.length === 0 ? h("div", { class: "option none" }, empty) : null,
    );
    at = Math.max(0, offered.findIndex((option) => option.value === now));
    root.classList.add("open");
    opener.setAttribute("aria-expanded", "true");
    const room = innerHeight - opener.getBoundingClientRect().bottom;
    root.classList.toggle("above", room < 260 && opener.getBoundingClientRect().top > room);
    list.focus();
    mark();
  };
  opener.addEventListener("click", () => (isOpen() ? close(true) : open()));
  opener.addEventListener("keydown", (event) => {
    if (event.key === "ArrowDown" || event.key === "ArrowUp") {
      event.preventDefault();
      open();
    }
  });
  list.addEventListener("keydown", (event) => {
    event.stopPropagation();
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (step) at = (at + step + offered.length) % Math.max(offered.length, 1);
    else if (event.key === "Home") at = 0;
    else if (event.key === "End") at = offered.length - 1;
    else if (event.key === "Escape" || event.key === "Tab") return close(event.key === "Escape");
    else if (event.key === "Enter" || event.key === " ") {
      event.preventDefault();
      const option = offered[at];
      return option ? take(option.value) : close(true);
    } else return;
    event.preventDefault();
    mark();
  });
  root.addEventListener("focusout", (event) => {
    if (!root.contains(event.relatedTarget as Node | null)) close(false);
  });
  show();
  return {
    root,
    get: () => now,
    set(next) {
      now = next;
      show();
    },
    offer(next) {
      offered = next;
      show();
    },
  };
}

/** A number on a line, with its value beside it. */
export function slider(
  { min, max, step, value, unit = "", log = false, digits }: { min: number; max: number; step: number; value: number; unit?: string; log?: boolean; digits?: number },
  change: (value: number, done: boolean) => void,
): Control<number> {
  const to = (number: number) => (log ? Math.log(number) : number);
  const from = (place: number) => (log ? Math.exp(place) : place);
  const rounded = (number: number) => Math.min(max, Math.max(min, Number((Math.round(number / step) * step).toPrecision(12))));
  const input = h("input", { type: "range", min: to(min), max: to(max), step: log ? (to(max) - to(min)) / 200 : step, value: to(value) });
  const box = h("input", { type: "text", inputmode: "decimal", class: "number", autocomplete: "off" });
  const places = digits ?? Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  let now = value;
  const show = () => {
    input.value = String(to(now));
    box.value = now.toFixed(places);
    const share = (to(now) - to(min)) / (to(max) - to(min) || 1);
    input.style.setProperty("--share", `${100 * share}%`);
  };
  const take = (number: number, done: boolean) => {
    now = rounded(number);
    show();
    change(now, done);
  };
  input.addEventListener("input", () => take(from(Number(input.value)), false));
  input.addEventListener("change", () => take(from(Number(input.value)), true));
  box.addEventListener("change", () => {
    const number = Number(box.value.replace(",", "."));
    if (Number.isFinite(number)) take(number, true);
    else show();
  });
  const root = h("div", { class: "slider" }, input, h("span", { class: "value" }, box, unit ? h("span", { class: "unit" }, unit) : null));
  new MutationObserver(() => {
    for (const part of [input, box]) part.setAttribute("aria-labelledby", root.getAttribute("aria-labelledby") ?? "");
  }).observe(root, { attributeFilter: ["aria-labelledby"] });
  show();
  return {
    root,
    get: () => now,
    set(next) {
      now = next;
      show();
    },
  };
}

/** On or off. */
export function toggle(label: string, value: boolean, change: (value: boolean) => void): Control<boolean> {
  let now = value;
  const root = h("button", { type: "button", role: "switch", class: "toggle" }, h("span", { class: "knob", "aria-hidden": "true" }), label);
  const show = () => root.setAttribute("aria-checked", String(now));
  root.addEventListener("click", () => {
    now = !now;
    show();
    change(now);
  });
  show();
  return {
    root,
    get: () => now,
    set(next) {
      now = next;
      show();
    },
  };
}

/** A line of text. */
export function line(value: string, change: (value: string) => void, placeholder = ""): Control<string> {
  const root = h("input", { type: "text", class: "line", value, placeholder, autocomplete: "off", spellcheck: "false" });
  root.addEventListener("input", () => change(root.value));
  return {
    root,
    get: () => root.value,
    set(next) {
      root.value = next;
    },
  };
}

/** A place without content: what it is for, and what to do. */
export function empty(title: string, text: string, ...actions: Child[]): HTMLElement {
  return h("div", { class: "empty-state" }, h("h2", {}, title), h("p", {}, text), h("div", { class: "row" }, ...actions));
}

const toasts = h("div", { class: "toasts", role: "status", "aria-live": "polite" });
document.body.append(toasts);

/** A short message that goes by itself; problems stay until they are closed. */
export function toast(text: string, kind: "info" | "problem" = "info"): void {
  const close = button("", () => one.remove(), { kind: "quiet", icon: "close", title: t("close") });
  const one = h("div", { class: `toast ${kind}` }, icon(kind === "problem" ? "warning" : "check"), h("span", {}, text), close);
  toasts.append(one);
  while (toasts.children.length > 4) toasts.firstElementChild?.remove();
  if (kind === "info") setTimeout(() => one.remove(), 4000);
}

/** Says what went wrong. */
export function report(error: unknown): void {
  toast(problemText(error), "problem");
}

export function problemText(error: unknown): string {
  const text = error instanceof Error ? error.message : String(error);
  return text || t("no-server");
}

export async function copy(text: string): Promise<void> {
  try {
    await navigator.clipboard.writeText(text);
    toast(t("copied"));
  } catch {
    toast(t("not-copied", { text }), "problem");
  }
}

/** A window above the page. */
export function dialog(title: string, ...children: Child[]): { root: HTMLDialogElement; close(): void } {
  const root = h("dialog", { class: "dialog", "aria-label": title });
  const close = () => root.close();
  root.append(h("header", {}, h("h2", {}, title), button("", close, { kind: "quiet", icon: "close", title: t("close") })), h("div", { class: "body" }, ...(children.filter(Boolean) as Node[])));
  root.addEventListener("close", () => root.remove());
  root.addEventListener("click", (event) => {
    if (event.target === root) close();
  });
  document.body.append(root);
  root.showModal();
  return { root, close };
}
