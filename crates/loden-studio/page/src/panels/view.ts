/** Materials on an object: drawn by the browser at once, and by the path tracer when asked. */

import { address, sendText } from "../api";
import { fill, h, icon } from "../dom";
import { hemisphere } from "../hemisphere";
import { bar, doing, jobs } from "../jobs";
import { type Job, type Material, model, stem } from "../model";
import { eye, firstLook, type Look, type Place, placeOf, Stage } from "../stage";
import { state, type State } from "../state";
import { type Key, t } from "../texts";
import { button, choice, copy, empty, field, problemText, report, segmented, slider } from "../widgets";
import { go, materialChoice, only, optionOf, save, type Panel } from "./common";

const MOST = 4;

interface Tile {
  root: HTMLElement;
  id: string;
  draw(look: Look, object: string, moving: boolean): void;
  refine(look: Look, place: Place, lighting: string, spp: number): void;
  clear(): void;
  picture(look: Look): Promise<Blob | null>;
  end(): void;
}

export function view(): Panel {
  const root = h("section", { class: "panel" });
  const none = empty(t("no-view"), t("no-view-text"), button(t("go-compress"), () => go("compression"), { kind: "primary" }));
  const material = materialChoice(t("material"), ["compressed"], (m) => state.change({ m }));
  const object = segmented(
    model.tables.objects.map((one) => ({ value: one.name, label: t(`object-${one.name}` as Key), doc: one.doc })),
    "sphere",
    (o) => state.change({ o: o === "sphere" ? undefined : o, cam: undefined }),
    t("object"),
  );
  const own = choice([], "", (o) => state.change({ o: o || undefined, cam: undefined }), t("own-none"));
  const around = choice([], "", (env) => state.change({ env: env || undefined, turn: undefined }), t("surroundings-none"));
  const turning = slider({ min: -180, max: 180, step: 1, value: 0, unit: "°" }, (degrees, done) => state.change({ turn: degrees || undefined }, done));
  const turningField = field(t("turn"), turning.root);
  const lamp = hemisphere(t("lamp"), (_, [theta, phi], done) => state.change({ key: `${theta},${phi}` }, done));
  lamp.free(true);
  const repeats = slider({ min: 0.5, max: 16, step: 0.5, value: 4, log: true }, (rep, done) => state.change({ rep: rep === 4 ? undefined : rep }, done));
  const api = segmented([{ value: "", label: t("api-webgpu") }, { value: "webgl", label: t("api-webgl") }], "", (gl) => state.change({ gl: gl || undefined }), t("api-label"));
  const others = h("div", { class: "fields" });
  const lighting = segmented(
    (["studio", "lamp"] as const).map((value) => ({ value, label: t(`refine-${value}`), doc: t(`refine-${value}-doc`) })),
    "studio",
    () => {},
    t("refine"),
  );
  const spp = segmented(["16", "64", "256"].map((value) => ({ value, label: value })), "64", () => {}, t("samples"));
  const status = h("p", { class: "hint status", role: "status" });
  const tiles = h("div", { class: "tiles" });
  const toolbar = h(
    "header",
    { class: "bar-line" },
    status,
    h("span", { class: "grow" }),
    button(t("reset-camera"), () => state.change({ cam: undefined }), { kind: "quiet", icon: "fit" }),
    button(t("copy-scene"), () => void scene(), { kind: "quiet", icon: "copy" }),
    button(t("save-picture"), () => void picture(), { kind: "quiet", icon: "save" }),
  );
  const lamps = h("div", { class: "fields" }, h("div", { class: "pickers" }, lamp.root), h("p", { class: "hint" }, t("lamp-hint")));
  const side = h(
    "aside",
    { class: "side" },
    material.root,
    field(t("object"), object.root),
    field(t("object-file"), own.root, t("object-file-hint")),
    field(t("surroundings"), around.root, t("surroundings-hint")),
    turningField,
    lamps,
    field(t("repeats"), repeats.root),
    field(t("side-materials"), others),
    h("div", { class: "group" }, h("h2", { class: "sub" }, t("refine")), h("div", { class: "fields" }, field(t("light"), lighting.root), field(t("samples"), spp.root)), button(t("refine"), () => refine(), { kind: "primary wide" })),
    field(t("api-label"), api.root),
    h(
      "div",
      { class: "group" },
      h("h2", { class: "sub" }, t("export")),
      button(t("save-html"), () => state.now.m && save(address("single", { m: chosen()[0]!.id })), { icon: "save", kind: "wide" }),
      button(t("save-file"), () => save(address("file", { m: chosen()[0]!.id })), { icon: "save", kind: "wide" }),
    ),
  );
  const whole = h("div", { class: "columns two" }, side, h("div", { class: "main" }, h("div", { class: "viewer" }, toolbar, tiles)));
  let shown: Tile[] = [];
  let place: Place | null = null;
  let placed = "";
  let still: ReturnType<typeof setTimeout> | undefined;
  let drawn = "";

  const chosen = (): Material[] => {
    const ids = [state.now.m, ...(state.now.more ?? "").split(" ")];
    return ids.flatMap((id) => model.of("compressed").filter((one) => one.id === id)).slice(0, MOST);
  };
  const objectName = () => ([...model.tables.objects.map((one) => one.name), ...model.extras.meshes.map((one) => one.id)].includes(state.now.o ?? "") ? state.now.o! : "sphere");
  const surroundings = () => {
    const found = model.extras.panoramas.find((one) => one.id === state.now.env);
    return found ? { id: found.id, turn: state.now.turn ?? 0 } : undefined;
  };
  const look = (): Look => {
    const first = firstLook(place!);
    const numbers = (state.now.cam ?? "").split(",").map(Number);
    if (numbers.length === 3 && numbers.every(Number.isFinite)) [first.azimuth, first.elevation, first.distance] = numbers as [number, number, number];
    const light = (state.now.key ?? "").split(",").map(Number);
    if (light.length === 2 && light.every(Number.isFinite)) first.light = [Math.min(90, Math.max(0, light[0]!)), light[1]!];
    first.surroundings = surroundings();
    first.repeats = Math.min(64, Math.max(0.1, state.now.rep ?? 4));
    return first;
  };
  const turn = (dx: number, dy: number, zoom: number, done: boolean | "quiet") => {
    if (!place) return;
    const now = look();
    const home = firstLook(place).distance;
    const azimuth = (((now.azimuth - dx + 180) % 360) + 360) % 360 - 180;
    const elevation = Math.min(85, Math.max(-85, now.elevation + dy));
    const distance = Math.min(4 * home, Math.max(0.3 * home, now.distance * zoom));
    state.change({ cam: [azimuth, elevation, distance].map((value) => Number(value.toFixed(3))).join() }, done);
  };
  const say = (stage: Stage | null, text: string) => {
    if (!stage) return void (status.textContent = text);
    const { api: by, software, webgpu } = stage.drawing;
    const parts = [t("drawn-by", { api: t(`api-${by}`) })];
    if (software) parts.push(t("by-software"));
    if (!webgpu) parts.push(t("no-webgpu"));
    if (surroundings()) parts.push(t("by-lights", { count: stage.lamps }));
    status.textContent = `${parts.join(" · ")}. ${t("orbit-hint")}.`;
    api.set(by === "webgl" ? "webgl" : "");
  };
  const redraw = (moving: boolean) => {
    const now = look();
    for (const tile of shown) tile.draw(now, objectName(), moving);
  };
  const refine = () => {
    if (!place) return;
    for (const tile of shown) tile.refine(look(), place, lighting.get(), Number(spp.get()));
  };
  const requestOf = (id: string, size: [number, number], light: string) => lookRequest(id, objectName(), look(), place!, light, size);
  const scene = async () => {
    const canvas = tiles.querySelector("canvas");
    const material = chosen()[0];
    if (!place || !canvas || !material) return;
    try {
      await copy(await sendText("scene", requestOf(material.id, [canvas.clientWidth, canvas.clientHeight], lighting.get())));
    } catch (error) {
      report(error);
    }
  };
  const picture = async () => {
    for (const tile of shown) {
      const blob = await tile.picture(look());
      if (!blob) continue;
      const url = URL.createObjectURL(blob);
      save(url, `${stem(model.material(tile.id)?.name ?? "picture")}-${stem(objectName().replace(/^.*\//, ""))}.png`);
      setTimeout(() => URL.revokeObjectURL(url), 10_000);
    }
  };
  const showOthers = () => {
    const extra = chosen().slice(1);
    const set = (ids: string[]) => state.change({ more: ids.join(" ") || undefined });
    fill(
      others,
      ...extra.map((one, k) =>
        h("div", { class: "row between" }, h("span", { class: "ellipsis" }, one.name), button("", () => set(extra.filter((_, at) => at !== k).map((other) => other.id)), { kind: "quiet", icon: "close", title: t("remove") })),
      ),
      extra.length < MOST - 1
        ? choice(model.of("compressed").filter((one) => !chosen().includes(one)).map(optionOf), "", (id) => set([...extra.map((one) => one.id), id]), t("add-material")).root
        : null,
    );
  };
  const orbit = (area: HTMLElement) => {
    area.addEventListener("pointerdown", (event) => {
      if (event.button === 0 && !(event.target instanceof HTMLButtonElement)) area.setPointerCapture(event.pointerId);
    });
    area.addEventListener("pointermove", (event) => {
      if (area.hasPointerCapture(event.pointerId)) turn(0.4 * event.movementX, 0.4 * event.movementY, 1, false);
    });
    area.addEventListener("pointerup", (event) => {
      if (area.hasPointerCapture(event.pointerId)) turn(0, 0, 1, true);
    });
    area.addEventListener("wheel", (event) => {
      event.preventDefault();
      turn(0, 0, Math.exp((event.deltaMode === 1 ? 16 * event.deltaY : event.deltaY) / 800), "quiet");
    }, { passive: false });
    area.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-5, 0], ArrowRight: [5, 0], ArrowUp: [0, -5], ArrowDown: [0, 5] }[event.key];
      if (step) turn(-step[0]!, -step[1]!, 1, true);
      else if (event.key === "+" || event.key === "=") turn(0, 0, 0.9, true);
      else if (event.key === "-") turn(0, 0, 1.1, true);
      else return;
      event.preventDefault();
    });
  };
  const show = (now: State) => {
    material.refresh();
    const wanted = now.m && model.material(now.m)?.holds !== "compressed" ? [] : chosen();
    if (wanted.length === 0) {
      shown.forEach((tile) => tile.end());
      shown = [];
      tiles.replaceChildren();
      drawn = "";
      only(root, none);
      return;
    }
    only(root, whole);
    material.set(wanted[0]!.id);
    object.set(objectName());
    own.offer([{ value: "", label: t("own-none") }, ...model.extras.meshes.map((one) => ({ value: one.id, label: one.name }))]);
    own.set(model.extras.meshes.some((one) => one.id === objectName()) ? objectName() : "");
    around.offer([{ value: "", label: t("surroundings-none"), doc: t("surroundings-doc") }, ...model.extras.panoramas.map((one) => ({ value: one.id, label: one.name }))]);
    around.set(surroundings()?.id ?? "");
    turning.set(now.turn ?? 0);
    turningField.hidden = !surroundings();
    lamps.hidden = Boolean(surroundings());
    repeats.set(now.rep ?? 4);
    const ids = wanted.map((one) => `${one.id} ${one.modified} ${now.gl ?? ""}`);
    if (ids.join() !== shown.map((tile) => tile.root.dataset.key).join()) {
      const kept = new Map(shown.map((tile) => [tile.root.dataset.key, tile]));
      for (const [key, tile] of kept) if (!ids.includes(key ?? "")) tile.end();
      shown = wanted.map((one, k) => {
        const old = kept.get(ids[k]);
        if (old) return old;
        const made = makeTile(one, now.gl, say);
        made.root.dataset.key = ids[k];
        orbit(made.root);
        return made;
      });
      tiles.replaceChildren(...shown.map((tile) => tile.root));
      tiles.dataset.count = String(shown.length);
      drawn = "";
    }
    const othersKey = `${ids} ${model.of("compressed").map((one) => one.id)}`;
    if (others.dataset.key !== othersKey) {
      others.dataset.key = othersKey;
      showOthers();
    }
    const name = objectName();
    void placeOf(name).then((found) => {
      if (objectName() !== name) return;
      [place, placed] = [found, name];
      const key = JSON.stringify([ids, placed, look()]);
      lamp.point(look().light);
      if (key === drawn) return;
      const moving = drawn !== "";
      drawn = key;
      for (const tile of shown) tile.clear();
      redraw(moving);
      clearTimeout(still);
      if (moving) still = setTimeout(() => redraw(false), 180);
    }, report);
  };
  new ResizeObserver(() => {
    if (place && shown.length) redraw(false);
  }).observe(tiles);
  return { root, show };
}

function lookRequest(material: string, object: string, look: Look, place: Place, lighting: string, size: [number, number]) {
  return { material, object, position: eye(look, place), target: place.target, light: look.light, lighting, surroundings: look.surroundings?.id ?? null, turn: look.surroundings?.turn ?? 0, scale: look.repeats, size };
}

function makeTile(material: Material, api: string | undefined, say: (stage: Stage | null, text: string) => void): Tile {
  const canvas = h("canvas", { class: "scene" });
  const message = h("div", { class: "tile-message", role: "status" });
  const rendered = h("img", { class: "rendered", alt: "", hidden: true });
  const progress = bar(t("job-picture"));
  const what = h("span", { class: "doing" });
  const stop = button(t("cancel"), () => job && void jobs.cancel(job.id));
  const back = button(t("back-to-view"), () => clear());
  const strip = h("div", { class: "strip", hidden: true }, progress.root, what, stop, back);
  const root = h("div", { class: "tile", tabindex: 0, role: "group", "aria-label": `${t("view")}: ${material.name}. ${t("orbit-hint")}` }, canvas, rendered, h("span", { class: "tile-name" }, material.name), message, strip);
  let stage: Stage | null = null;
  let ended = false;
  let last: [Look, string, boolean] | null = null;
  let job: Job | null = null;

  const note = (text: string) => {
    message.textContent = text;
    message.hidden = !text;
    if (text) say(null, text);
  };
  const ready = Stage.make(canvas, material.id, api, note).then(
    (made) => {
      if (ended) return made.end();
      stage = made;
      if (last) void put(...last);
    },
    (error) => {
      message.replaceChildren(icon("warning"), h("strong", {}, t("cannot-draw")), h("span", {}, problemText(error)));
      message.hidden = false;
      say(null, t("cannot-draw"));
    },
  );
  void ready;
  const put = async (look: Look, object: string, moving: boolean) => {
    try {
      await Promise.all([stage!.wear(object), stage!.surround(look.surroundings?.id)]);
      stage!.draw(look, moving);
      note("");
      say(stage, "");
    } catch (error) {
      report(error);
    }
  };
  const clear = () => {
    if (job && ["queued", "running"].includes(job.phase)) void jobs.cancel(job.id);
    job = null;
    rendered.hidden = true;
    strip.hidden = true;
  };
  const follow = (now: Job) => {
    if (job?.id !== now.id) return;
    job = now;
    progress.show(now);
    const running = now.phase === "running" || now.phase === "queued";
    what.textContent = now.error ?? doing(now);
    stop.hidden = !running;
    back.hidden = running;
    if (now.pictures && rendered.dataset.shown !== `${now.id} ${now.pictures}`) {
      rendered.dataset.shown = `${now.id} ${now.pictures}`;
      const next = new Image();
      next.src = address(`jobs/${now.id}/picture`, { k: now.pictures });
      void next.decode().then(() => {
        if (job?.id !== now.id) return;
        rendered.src = next.src;
        rendered.hidden = false;
      }, () => {});
    }
  };
  return {
    root,
    id: material.id,
    draw(look, object, moving) {
      last = [look, object, moving];
      if (stage) void put(look, object, moving);
    },
    refine(look, place, lighting, spp) {
      clear();
      const size: [number, number] = [Math.min(2048, Math.round(canvas.clientWidth)), Math.min(2048, Math.round(canvas.clientHeight))];
      const object = last?.[1] ?? "sphere";
      strip.hidden = false;
      void jobs.start("picture", { look: lookRequest(material.id, object, look, place, lighting, size), spp }, follow).then((started) => {
        job = started;
        follow(started);
      }, (error) => {
        strip.hidden = true;
        report(error);
      });
    },
    clear,
    async picture(look) {
      if (!rendered.hidden) return (await fetch(rendered.src)).blob();
      return stage ? stage.picture(look) : null;
    },
    end() {
      ended = true;
      clear();
      stage?.end();
    },
  };
}
