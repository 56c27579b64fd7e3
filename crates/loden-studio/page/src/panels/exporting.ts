/** Materials for other programs. */

import { address } from "../api";
import { fill, h } from "../dom";
import { bar, doing, jobs } from "../jobs";
import { type Job, model, stem } from "../model";
import { state, type State } from "../state";
import { t } from "../texts";
import { button, empty, report } from "../widgets";
import { go, materialChoice, only, type Panel, save } from "./common";

const FINISHED = ["done", "failed", "cancelled"];

export function exporting(): Panel {
  const root = h("section", { class: "panel" });
  const none = empty(t("no-export"), t("no-export-text"), button(t("go-compress"), () => go("compression"), { kind: "primary" }));
  const material = materialChoice(t("material"), ["compressed"], (m) => state.change({ m }));
  const list = h("div", { class: "targets" });
  const whole = h("div", { class: "narrow" }, material.root, list);
  let shown = "";
  const show = (now: State) => {
    material.refresh();
    const found = model.of("compressed").find((one) => one.id === now.m);
    if (!found) {
      if (model.of("compressed").length && now.panel === "export" && !now.m) {
        material.set("");
        only(root, h("div", { class: "narrow" }, material.root, h("p", { class: "hint" }, t("no-export-text"))));
        return;
      }
      only(root, none);
      return;
    }
    fill(whole, material.root, list);
    only(root, whole);
    material.set(found.id);
    if (shown === found.id) return;
    shown = found.id;
    fill(list, single(found.id), ...model.tables.renderers.map((renderer) => target(found.id, found.name, renderer.name, renderer.doc)));
  };
  return { root, show };
}

function single(id: string): HTMLElement {
  return h("section", { class: "target" }, h("h2", { class: "sub" }, t("export-single")), h("p", { class: "hint" }, t("export-single-text")), h("div", { class: "row" }, button(t("download"), () => save(address("single", { m: id })), { icon: "save" })));
}

function target(id: string, name: string, renderer: string, doc: string): HTMLElement {
  const progress = bar(renderer);
  const what = h("span", { class: "doing" });
  const actions = h("div", { class: "row" });
  const running = h("div", { class: "running" }, progress.root, what);
  const root = h("section", { class: "target" }, h("h2", { class: "sub" }, renderer), h("p", { class: "hint" }, doc), running, actions);
  const begin = () => {
    const folder = freeFolder(`${stem(name)}-${renderer}`);
    void jobs.start("export", { material: id, renderer, name: folder }, follow).then(follow, report);
  };
  const idle = () => fill(actions, button(t("export"), begin, { icon: "export" }));
  const follow = (job: Job) => {
    root.classList.toggle("busy", !FINISHED.includes(job.phase));
    progress.show(job);
    what.textContent = doing(job);
    if (!FINISHED.includes(job.phase)) fill(actions, button(t("cancel"), () => void jobs.cancel(job.id)));
    else if (job.phase === "done") fill(actions, button(t("download"), () => save(`/api/jobs/${job.id}/download`), { icon: "save", kind: "primary" }), h("span", { class: "hint" }, t("writes", { file: job.output ?? "" })));
    else idle();
  };
  idle();
  return root;
}

/** A name for a folder that no job of this run has taken. */
function freeFolder(wanted: string): string {
  const taken = new Set(jobs.list.filter((job) => job.kind === "export" && job.phase !== "failed" && job.phase !== "cancelled").map((job) => job.title));
  let name = wanted;
  for (let k = 2; taken.has(name); k++) name = `${wanted}-${k}`;
  return name;
}
