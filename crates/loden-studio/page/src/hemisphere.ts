/** Directions above a surface, seen from above: the polar angle grows from the centre to the edge, the azimuth counter-clockwise
 * from the right. Measured directions are dots. */

import { h, s } from "./dom";
import { t } from "./texts";

export type Angles = [theta: number, phi: number];

const RADIUS = 100;

/** Where a direction is in the picture. */
export function place([theta, phi]: Angles): [number, number] {
  const r = (RADIUS * theta) / 90;
  const a = (phi * Math.PI) / 180;
  return [r * Math.cos(a), -r * Math.sin(a)];
}

function anglesAt(x: number, y: number): Angles {
  const theta = Math.min(90, (90 * Math.hypot(x, y)) / RADIUS);
  const phi = (Math.atan2(-y, x) * 180) / Math.PI;
  return [Math.round(theta * 10) / 10, Math.round(((phi + 360) % 360) * 10) / 10];
}

export interface Hemisphere {
  root: HTMLElement;
  /** Shows measured directions, and which of them is chosen; `missing` are drawn hollow. */
  offer(directions: Angles[], missing: Set<number>): void;
  choose(index: number): void;
  /** Shows a direction that need not be measured. */
  point(angles: Angles): void;
  /** Whether any direction can be picked. */
  free(on: boolean): void;
  /** Colours of the dots, as CSS. */
  color(colors: (string | undefined)[]): void;
}

/** A picker. `change` is told the nearest measured direction, or any where that is allowed; `done` is false while dragging. */
export function hemisphere(label: string, change: (index: number, angles: Angles, done: boolean) => void, most = 90): Hemisphere {
  let directions: Angles[] = [];
  let missing = new Set<number>();
  let chosen = -1;
  let at: Angles = [0, 0];
  let isFree = false;
  let dots: SVGCircleElement[] = [];
  const rings = [15, 30, 45, 60, 75, 90].map((theta) => s("circle", { class: theta === 90 ? "edge" : "ring", r: (RADIUS * theta) / 90 }));
  const axes = [0, 90].map((phi) => {
    const [x, y] = place([90, phi]);
    return s("line", { class: "ring", x1: -x, y1: -y, x2: x, y2: y });
  });
  const layer = s("g");
  const line = s("line", { class: "needle" });
  const mark = s("circle", { class: "mark", r: 6.5 });
  const svg = s("svg", { viewBox: "-108 -108 216 216", class: "dome", "aria-hidden": "true" }, s("circle", { class: "sky", r: RADIUS }), ...rings, ...axes, layer, line, mark);
  const text = h("output", { class: "angles" });
  const pad = h("div", { class: "pad", tabindex: 0, role: "slider", "aria-label": label, "aria-valuemin": 0 }, svg);
  const root = h("div", { class: "hemisphere" }, h("div", { class: "caption" }, h("span", { class: "label" }, label), text), pad);

  const show = () => {
    const [x, y] = place(at);
    for (const [name, value] of Object.entries({ cx: x, cy: y })) mark.setAttribute(name, String(value));
    line.setAttribute("x2", String(x));
    line.setAttribute("y2", String(y));
    text.textContent = `${at[0].toFixed(isFree ? 1 : 0)}°, ${at[1].toFixed(isFree ? 1 : 0)}°`;
    pad.setAttribute("aria-valuetext", t("theta-phi", { theta: at[0], phi: at[1] }));
    pad.setAttribute("aria-valuemax", String(Math.max(0, directions.length - 1)));
    pad.setAttribute("aria-valuenow", String(Math.max(0, chosen)));
    mark.classList.toggle("missing", !isFree && missing.has(chosen));
  };
  const nearest = (x: number, y: number, except = -1) => {
    let best = -1;
    let least = Infinity;
    directions.forEach((direction, k) => {
      if (k === except) return;
      const [px, py] = place(direction);
      const distance = (px - x) ** 2 + (py - y) ** 2;
      if (distance < least) [best, least] = [k, distance];
    });
    return best;
  };
  const take = (angles: Angles, done: boolean) => {
    const [x, y] = place([Math.min(angles[0], most), angles[1]]);
    const index = nearest(x, y);
    if (!isFree && index < 0) return;
    const next: Angles = isFree ? anglesAt(x, y) : directions[index]!;
    if (!done && next[0] === at[0] && next[1] === at[1]) return;
    [chosen, at] = [index, next];
    show();
    change(index, at, done);
  };
  const under = (event: PointerEvent): Angles => {
    const box = svg.getBoundingClientRect();
    const scale = 216 / box.width;
    return anglesAt((event.clientX - box.left) * scale - 108, (event.clientY - box.top) * scale - 108);
  };
  pad.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    pad.setPointerCapture(event.pointerId);
    take(under(event), false);
  });
  pad.addEventListener("pointermove", (event) => {
    if (pad.hasPointerCapture(event.pointerId)) take(under(event), false);
  });
  pad.addEventListener("pointerup", (event) => {
    if (pad.hasPointerCapture(event.pointerId)) take(under(event), true);
  });
  pad.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!step) return;
    event.preventDefault();
    const [x, y] = place(at);
    const [dx, dy] = step as [number, number];
    if (isFree) return take(anglesAt(x + 2 * dx, y + 2 * dy), true);
    // the nearest direction on that side
    let best = -1;
    let least = Infinity;
    directions.forEach((direction, k) => {
      const [px, py] = place(direction);
      const along = (px - x) * dx + (py - y) * dy;
      const across = Math.abs((px - x) * dy) + Math.abs((py - y) * dx);
      if (along > 0.5 && along + 2 * across < least) [best, least] = [k, along + 2 * across];
    });
    if (best >= 0) take(directions[best]!, true);
  });
  return {
    root,
    offer(next, without) {
      [directions, missing] = [next, without];
      // a direction that occurs in several pairs is one dot
      const seen = new Set<string>();
      dots = next.map((direction, k) => {
        const [cx, cy] = place(direction);
        const dot = s("circle", { cx, cy, r: next.length > 200 ? 1.7 : 2.6, class: missing.has(k) ? "dot missing" : "dot" });
        const key = direction.join();
        if (seen.has(key)) dot.style.display = "none";
        seen.add(key);
        return dot;
      });
      layer.replaceChildren(...dots);
      show();
    },
    choose(index) {
      chosen = index;
      at = directions[index] ?? [0, 0];
      show();
    },
    point(angles) {
      at = angles;
      const [x, y] = place(angles);
      chosen = nearest(x, y);
      show();
    },
    free(on) {
      isFree = on;
      show();
    },
    color(colors) {
      dots.forEach((dot, k) => {
        dot.style.fill = colors[k] ?? "";
        dot.classList.toggle("colored", colors[k] !== undefined);
      });
    },
  };
}
