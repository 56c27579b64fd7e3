/** The lobes of BRDFs for one direction of the light, in space: turned by dragging or by arrow keys. */

import { get, Scrub } from "./api";
import { h } from "./dom";
import { t } from "./texts";
import { field, report, slider } from "./widgets";

interface Lobes {
  /** The largest polar angle, degrees. */
  most: number;
  thetas: number;
  phis: number;
  lobes: { name: string; values: number[] }[];
}

type Point = [number, number, number];

const [WIDTH, HEIGHT] = [900, 440];

export function lobes(): { root: HTMLElement; show(ids: string[]): void } {
  const canvas = h("canvas", { class: "lobe", width: WIDTH, height: HEIGHT, tabindex: 0, role: "img", "aria-label": `${t("plot-lobe")}. ${t("orbit-hint")}` });
  const legend = h("div", { class: "legend" });
  const light = slider({ min: 0, max: 85, step: 1, value: 45, unit: "°" }, () => ask());
  const root = h("figure", { class: "plot lobes" }, canvas, h("div", { class: "lobe-line" }, legend, field(t("lobe-light"), light.root)), h("figcaption", {}, h("strong", {}, t("plot-lobe")), ` ${t("plot-lobe-doc")}`));
  const scrub = new Scrub();
  let [azimuth, elevation] = [-35, 22];
  let ids: string[] = [];
  let found: Lobes | null = null;
  let down: [number, number] | null = null;

  const ask = () => {
    scrub.run(async () => {
      try {
        found = await get<Lobes>("lobe", { m: ids, theta: light.get() });
        draw();
      } catch (error) {
        report(error);
      }
    });
  };
  const draw = () => {
    if (!found) return;
    const style = getComputedStyle(root);
    const color = (k: number) => style.getPropertyValue(`--s${k % 6}`).trim();
    legend.replaceChildren(
      ...found.lobes.map(({ name }, k) => {
        const dot = h("span", { class: "dot" });
        dot.style.background = color(k);
        return h("span", { class: "lobe-name" }, dot, name);
      }),
    );
    paint(canvas.getContext("2d")!, found, light.get(), [azimuth, elevation], color, style.getPropertyValue("--line").trim());
  };
  const turn = (dx: number, dy: number) => {
    azimuth += dx;
    elevation = Math.min(89, Math.max(-20, elevation + dy));
    draw();
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    down = [event.clientX, event.clientY];
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!down) return;
    turn(0.4 * (event.clientX - down[0]), 0.4 * (event.clientY - down[1]));
    down = [event.clientX, event.clientY];
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (down = null));
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-6, 0], ArrowRight: [6, 0], ArrowUp: [0, -6], ArrowDown: [0, 6] }[event.key];
    if (!step) return;
    event.preventDefault();
    turn(step[0]!, step[1]!);
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  return {
    root,
    show(next) {
      ids = next;
      ask();
    },
  };
}

/** Draws the lobes as facets, the farthest first, above a disc with the direction of the light. */
function paint(context: CanvasRenderingContext2D, { most: last, thetas, phis, lobes }: Lobes, light: number, [azimuth, elevation]: [number, number], color: (k: number) => string, line: string): void {
  const radians = Math.PI / 180;
  const most = Math.max(...lobes.flatMap((lobe) => lobe.values), 1e-6);
  const scale = 0.66 * HEIGHT;
  const [ca, sa, ce, se] = [Math.cos(azimuth * radians), Math.sin(azimuth * radians), Math.cos(elevation * radians), Math.sin(elevation * radians)];
  // right, up, towards the eye
  const seen = ([x, y, z]: Point): Point => {
    const [right, deep] = [x * ca - y * sa, x * sa + y * ca];
    return [WIDTH / 2 + scale * right, 0.74 * HEIGHT - scale * (z * ce - deep * se), deep * ce + z * se];
  };
  const at = (r: number, theta: number, phi: number): Point => [r * Math.sin(theta) * Math.cos(phi), r * Math.sin(theta) * Math.sin(phi), r * Math.cos(theta)];
  context.clearRect(0, 0, WIDTH, HEIGHT);
  context.strokeStyle = line;
  context.lineWidth = 1.5;
  for (const radius of [0.33, 0.66, 1]) {
    context.beginPath();
    for (let k = 0; k <= 64; k++) context.lineTo(...(seen(at(radius, Math.PI / 2, (2 * Math.PI * k) / 64)).slice(0, 2) as [number, number]));
    context.stroke();
  }
  const facets: { points: Point[]; depth: number; shade: number; k: number }[] = [];
  lobes.forEach(({ values }, k) => {
    const point = (i: number, j: number) => at(values[i * phis + (j % phis)]! / most, (radians * last * i) / (thetas - 1), (2 * Math.PI * j) / phis);
    for (let i = 0; i + 1 < thetas; i++) {
      for (let j = 0; j < phis; j++) {
        const corners = [point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)];
        const [a, b] = [difference(corners[2]!, corners[0]!), difference(corners[3]!, corners[1]!)];
        const normal: Point = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        const shade = Math.abs(normal[0] * 0.3 - normal[1] * 0.4 + normal[2] * 0.85) / (Math.hypot(...normal) || 1);
        const points = corners.map(seen);
        facets.push({ points, depth: points.reduce((sum, one) => sum + one[2], 0), shade, k });
      }
    }
  });
  facets.sort((a, b) => a.depth - b.depth);
  for (const { points, shade, k } of facets) {
    context.beginPath();
    for (const [x, y] of points) context.lineTo(x, y);
    context.closePath();
    const [towards, share] = shade > 0.5 ? ["white", 0.5 * (shade - 0.5)] : ["black", 0.9 * (0.5 - shade)];
    context.fillStyle = `color-mix(in oklab, ${towards} ${Math.round(100 * share)}%, ${color(k)})`;
    context.globalAlpha = lobes.length > 1 ? 0.72 : 1;
    context.fill();
    if (lobes.length > 1) continue;
    // no gaps between neighbours
    context.strokeStyle = context.fillStyle;
    context.lineWidth = 0.8;
    context.stroke();
  }
  context.globalAlpha = 1;
  const [fromX, fromY] = seen(at(1.15, light * radians, Math.PI));
  const [toX, toY] = seen([0, 0, 0]);
  context.strokeStyle = context.fillStyle = "#e0a020";
  context.lineWidth = 3;
  context.beginPath();
  context.moveTo(fromX, fromY);
  context.lineTo(toX, toY);
  context.stroke();
  context.beginPath();
  context.arc(fromX, fromY, 7, 0, 2 * Math.PI);
  context.fill();
}

function difference(a: Point, b: Point): Point {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}
