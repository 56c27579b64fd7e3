/** The jobs of the server: a list at the side, and news for those who started them. */

import { get, Problem, renew, send } from "./api";
import { fill, h, icon } from "./dom";
import { type Job, model } from "./model";
import { type Key, seconds, t } from "./texts";
import { button, copy, empty, report, toast } from "./widgets";

/** Jobs whose results are seen where they were asked for. */
const SHOWN = ["picture", "grid", "steps"];

const FINISHED = ["done", "failed", "cancelled"];

class Jobs {
  list: Job[] = [];
  private watched = new Map<number, (job: Job) => void>();
  private listeners: (() => void)[] = [];
  private timer: ReturnType<typeof setTimeout> | undefined;
  private lost = false;
  private known = new Map<number, string>();

  onChange(listener: () => void): void {
    this.listeners.push(listener);
  }

  /** Starts a job and follows it. */
  async start(kind: string, request: Record<string, unknown>, news?: (job: Job) => void): Promise<Job> {
    const job = await send<Job>("POST", "jobs", { kind, ...request });
    this.known.set(job.id, job.phase);
    if (news) this.watched.set(job.id, news);
    this.list = [...this.list, job];
    this.tell();
    this.poll(150);
    return job;
  }

  async cancel(id: number): Promise<void> {
    await send("POST", `jobs/${id}/cancel`).catch(report);
    this.poll(0);
  }

  async forget(id: number): Promise<void> {
    await send("DELETE", `jobs/${id}`).catch(report);
    this.poll(0);
  }

  poll(delay: number): void {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => void this.update(), delay);
  }

  private async update(): Promise<void> {
    try {
      this.list = await get<Job[]>("jobs");
      if (this.lost) {
        // it may have been started anew
        await renew();
        await model.refresh();
        toast(t("server-back"));
      }
      this.lost = false;
      document.body.classList.remove("lost");
    } catch (error) {
      if (error instanceof Problem && error.status === 0) {
        if (!this.lost) toast(t("server-gone"), "problem");
        this.lost = true;
        document.body.classList.add("lost");
      }
      this.poll(3000);
      return;
    }
    let isNew = false;
    for (const job of this.list) {
      const before = this.known.get(job.id);
      this.known.set(job.id, job.phase);
      this.watched.get(job.id)?.(job);
      if (!FINISHED.includes(job.phase)) continue;
      this.watched.delete(job.id);
      if (before === undefined || FINISHED.includes(before)) continue;
      if (job.output && job.phase === "done") isNew = true;
      if (job.phase === "failed") toast(t("job-failed", { name: job.title, error: job.error ?? "" }), "problem");
      else if (job.phase === "done" && !SHOWN.includes(job.kind)) toast(t("job-done", { name: job.title }));
    }
    if (isNew) await model.refresh().catch(report);
    this.tell();
    const active = this.list.some((job) => !FINISHED.includes(job.phase));
    this.poll(active ? 400 : 5000);
  }

  private tell(): void {
    for (const listener of this.listeners) listener();
  }
}

export const jobs = new Jobs();

/** What a job is doing, in a line. */
export function doing(job: Job): string {
  if (job.phase !== "running") return t(`phase-${job.phase}` as Key);
  const parts = [job.stage || job.task, job.stage && job.task && job.stage !== job.task ? job.task : ""];
  return parts.filter(Boolean).join(" · ") || t("phase-running");
}

/** A bar that shows how far a job is. */
export function bar(label: string): { root: HTMLElement; show(job: Job): void } {
  const inner = h("div", { class: "bar-inner" });
  const root = h("div", { class: "bar", role: "progressbar", "aria-label": label, "aria-valuemin": 0, "aria-valuemax": 100 }, inner);
  return {
    root,
    show(job) {
      const share = job.phase === "done" ? 1 : (job.fraction ?? 0);
      root.className = `bar ${job.phase} ${job.phase === "running" && job.fraction === null ? "busy" : ""}`;
      inner.style.width = `${100 * share}%`;
      root.setAttribute("aria-valuenow", String(Math.round(100 * share)));
    },
  };
}

/** The list of all jobs, newest first. */
export function drawer(open: (job: Job) => void): HTMLElement {
  const rows = new Map<number, { root: HTMLElement; show(job: Job): void }>();
  const list = h("div", { class: "job-list" });
  const note = h("p", { class: "hint" });
  const root = h("div", { class: "drawer-body" }, note, list);
  const show = () => {
    note.textContent = model.listed.output ? t("writes-to", { folder: model.listed.output }) : "";
    if (jobs.list.length === 0) {
      rows.clear();
      fill(list, empty(t("no-jobs"), t("no-jobs-text")));
      return;
    }
    for (const id of rows.keys()) if (!jobs.list.some((job) => job.id === id)) rows.delete(id);
    const ordered = [...jobs.list].reverse();
    for (const job of ordered) {
      if (!rows.has(job.id)) rows.set(job.id, row(job, open));
      rows.get(job.id)!.show(job);
    }
    const wanted = ordered.map((job) => rows.get(job.id)!.root);
    if (wanted.some((root, k) => list.children[k] !== root) || list.children.length !== wanted.length) list.replaceChildren(...wanted);
  };
  jobs.onChange(show);
  model.onChange(show);
  show();
  return root;
}

function row(first: Job, open: (job: Job) => void): { root: HTMLElement; show(job: Job): void } {
  let now = first;
  const progress = bar(first.title);
  const what = h("span", { class: "doing" });
  const time = h("span", { class: "time" });
  const more = h("div", { class: "job-more" });
  const actions = h("div", { class: "row" });
  const root = h(
    "section",
    { class: "job", "aria-label": `${t(`job-${first.kind}` as Key)} ${first.title}` },
    h("div", { class: "job-head" }, h("span", { class: "chip" }, t(`job-${first.kind}` as Key)), h("strong", {}, first.title)),
    progress.root,
    h("div", { class: "job-line" }, what, time),
    more,
    actions,
  );
  let shown = "";
  return {
    root,
    show(job) {
      now = job;
      progress.show(job);
      what.textContent = doing(job);
      what.classList.toggle("bad", job.phase === "failed");
      time.textContent = job.phase === "running" && job.remaining_s !== null ? t("left", { time: seconds(job.remaining_s) }) : job.seconds ? seconds(job.seconds) : "";
      const key = `${job.phase} ${job.warnings.length}`;
      if (key === shown) return;
      shown = key;
      fill(
        more,
        job.error ? h("p", { class: "bad" }, job.error) : null,
        job.output ? h("p", { class: "hint" }, t("writes", { file: job.output })) : null,
        ...job.warnings.map((warning) => h("p", { class: "warning" }, icon("warning"), warning)),
      );
      const finished = FINISHED.includes(job.phase);
      fill(
        actions,
        finished ? null : button(t("cancel"), () => void jobs.cancel(now.id)),
        job.phase === "done" && job.kind !== "picture" ? button(t(job.kind === "export" ? "download" : "look"), () => open(now)) : null,
        button(t("copy-command"), () => void copy(now.command), { kind: "quiet", icon: "copy" }),
        finished ? button("", () => void jobs.forget(now.id), { kind: "quiet", icon: "close", title: t("forget") }) : null,
      );
    },
  };
}
