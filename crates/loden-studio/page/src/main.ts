/** The page: a head with the panels, the panel itself, and a drawer with the jobs. */

import "./style.css";
import { fill, h, icon } from "./dom";
import { drawer, jobs } from "./jobs";
import { type Job, model } from "./model";
import { compression } from "./panels/compression";
import { create } from "./panels/create";
import { exporting } from "./panels/exporting";
import { gallery } from "./panels/gallery";
import { originals } from "./panels/originals";
import { go, type Panel, save } from "./panels/common";
import { view } from "./panels/view";
import { state } from "./state";
import { choose, type Key, language, t } from "./texts";
import { button, copy, dialog, problemText, report, segmented } from "./widgets";

const PANELS: Record<string, () => Panel> = { gallery, originals, compression, view, create, export: exporting };
const NAMES = Object.keys(PANELS);

const root = document.documentElement;
function theme(name: string): void {
  if (name === "auto") delete root.dataset.theme;
  else root.dataset.theme = name;
  localStorage.setItem("theme", name);
}
theme(localStorage.getItem("theme") ?? "auto");

const made = new Map<string, Panel>();
const place = h("main", { id: "content", tabindex: "-1" });

function show(): void {
  const name = NAMES.includes(state.now.panel) ? state.now.panel : "gallery";
  if (!made.has(name)) made.set(name, PANELS[name]!());
  const panel = made.get(name)!;
  if (place.firstElementChild !== panel.root) place.replaceChildren(panel.root);
  panel.show(state.now);
  for (const tab of document.querySelectorAll<HTMLElement>("[data-panel]")) {
    if (tab.dataset.panel === name) tab.setAttribute("aria-current", "page");
    else tab.removeAttribute("aria-current");
  }
  undo.disabled = !state.canUndo();
  const material = model.material(state.now.m);
  heading.textContent = t(name as Key);
  document.title = `${material && name !== "gallery" ? `${material.name} · ` : ""}${t(name as Key)} · ${t("title")}`;
}

const undo = button("", () => state.undo(), { kind: "quiet", icon: "undo", title: `${t("undo")} (Ctrl+Z)` });
const badge = h("span", { class: "badge", hidden: true });
const opener = button("", () => toggleDrawer(), { kind: "quiet jobs-button", icon: "jobs" });
opener.title = `${t("jobs")} (J)`;
opener.append(h("span", { class: "wide-only" }, t("jobs")), badge);
const heading = h("h1", { class: "unseen" });

function openJob(job: Job): void {
  if (job.kind === "export") return save(`/api/jobs/${job.id}/download`);
  if (job.kind === "grid" || job.kind === "steps") {
    toggleDrawer(false);
    return go("create", { how: job.kind === "grid" ? "exchange" : "mix", try: job.id, c: undefined });
  }
  const found = model.listed.materials.find((material) => material.name === job.title);
  toggleDrawer(false);
  if (!found) return;
  if (job.kind === "compress" && found.source) go("compression", { m: model.of("btf").find((one) => one.name === found.source)?.id ?? found.id, c: found.id });
  else go("originals", { m: found.id, x: undefined, y: undefined });
}

let side: HTMLElement;
function toggleDrawer(open = !document.body.classList.contains("drawer-open")): void {
  document.body.classList.toggle("drawer-open", open);
  opener.setAttribute("aria-expanded", String(open));
  side.inert = !open;
  if (open) side.querySelector<HTMLElement>("button")?.focus();
}

function settings(): void {
  const row = (keys: string, text: string) => [h("dt", {}, h("kbd", {}, keys)), h("dd", {}, text)];
  dialog(
    t("shortcuts"),
    h("div", { class: "fields" },
      h("div", { class: "field" }, h("span", { class: "label" }, t("language")), segmented([{ value: "en", label: "English" }, { value: "de", label: "Deutsch" }], language, (value) => choose(value === "de" ? "de" : "en"), t("language")).root),
      h("div", { class: "field" }, h("span", { class: "label" }, t("theme")), segmented((["auto", "light", "dark"] as const).map((value) => ({ value, label: t(`theme-${value}`) })), localStorage.getItem("theme") ?? "auto", theme, t("theme")).root),
    ),
    h("dl", { class: "keys" },
      ...NAMES.flatMap((name, k) => row(String(k + 1), `${t("key-panels")}: ${t(name as Key)}`)),
      ...row("Ctrl Z", t("key-undo")), ...row("J", t("key-jobs")), ...row("/", t("key-search")), ...row("← ↑ → ↓", t("key-move")), ...row("+ − 0", t("key-zoom")), ...row("?", t("key-help")),
    ),
    h("p", { class: "hint" }, `loden ${model.tables.version}`),
  );
}

function shell(): void {
  const tabs = NAMES.map((name) =>
    h("button", { type: "button", class: "tab", "data-panel": name, onclick: () => go(name, { how: undefined }) }, icon(name), h("span", {}, t(name as Key))),
  );
  side = h("aside", { class: "drawer", "aria-label": t("jobs"), inert: true }, h("header", {}, h("h2", {}, t("jobs")), button("", () => toggleDrawer(false), { kind: "quiet", icon: "close", title: t("close") })), drawer(openJob));
  document.body.prepend(
    h("a", { class: "skip", href: "#content", onclick: (event: Event) => { event.preventDefault(); place.focus(); } }, t("skip")),
    h(
      "header",
      { class: "top" },
      h("button", { type: "button", class: "brand", onclick: () => go("gallery") }, h("img", { src: "/icon.svg", alt: "", width: 24, height: 24 }), h("span", {}, "loden", h("em", {}, " studio"))),
      heading,
      h("nav", { class: "tabs", "aria-label": t("panels") }, ...tabs),
      h("div", { class: "row tools" }, undo, button("", () => void copy(state.link()), { kind: "quiet narrow-off", icon: "copy", title: t("copy-link") }), button("", settings, { kind: "quiet", icon: "keyboard", title: `${t("shortcuts")} (?)` }), opener),
    ),
    place,
    side,
  );
}

addEventListener("keydown", (event) => {
  const target = event.target as HTMLElement;
  const typing = target.matches("input, textarea") && (target as HTMLInputElement).type !== "range";
  if ((event.ctrlKey || event.metaKey) && event.key === "z" && !typing) {
    event.preventDefault();
    return state.undo();
  }
  if (typing || event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
  const panel = NAMES[Number(event.key) - 1];
  if (panel) go(panel, { how: undefined });
  else if (event.key === "j") toggleDrawer();
  else if (event.key === "?") settings();
  else if (event.key === "Escape") toggleDrawer(false);
  else if (event.key === "/") {
    event.preventDefault();
    go("gallery");
    document.getElementById("search")?.focus();
  }
});

async function start(): Promise<void> {
  try {
    await model.start();
  } catch (error) {
    fill(document.body, h("p", { class: "hint center" }, problemText(error)));
    return;
  }
  shell();
  state.onChange(show);
  model.onChange(show);
  jobs.onChange(() => {
    const active = jobs.list.filter((job) => job.phase === "running" || job.phase === "queued").length;
    badge.textContent = String(active);
    badge.hidden = active === 0;
  });
  show();
  jobs.poll(0);
  await model.refresh().catch(report);
  addEventListener("focus", () => void model.refresh().catch(() => {}));
}

void start();
