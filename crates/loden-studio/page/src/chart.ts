/** Size against error on logarithmic axes: a point for each compressed form. */

import { fill, h, s } from "./dom";
import type { Material } from "./model";
import { bytes, number, t } from "./texts";

const [WIDTH, HEIGHT] = [560, 300];
const FIELD = { left: 58, right: 548, top: 14, bottom: 258 };

/** Colours and shapes of methods, so that colour is not all that tells them apart. */
const SHAPES = ["circle", "square", "diamond", "triangle"];

function ticks(low: number, high: number): number[] {
  const found: number[] = [];
  // a short axis has every digit
  const digits = high / low < 8 ? [1, 2, 3, 4, 5, 6, 8] : [1, 2, 5];
  for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++) {
    for (const m of digits) {
      const tick = m * 10 ** power;
      if (tick >= low * 0.999 && tick <= high * 1.001) found.push(tick);
    }
  }
  return found;
}

function symbol(shape: string, x: number, y: number): SVGElement {
  const path = { square: `M${x - 4.5} ${y - 4.5}h9v9h-9z`, diamond: `M${x} ${y - 6}l6 6-6 6-6-6z`, triangle: `M${x} ${y - 6}l5.500 10h-11z` }[shape];
  return path ? s("path", { d: path }) : s("circle", { cx: x, cy: y, r: 5 });
}

/** A chart. `choose` is told which form was clicked. */
export function chart(choose: (id: string) => void): { root: HTMLElement; show(forms: Material[], chosen: string | undefined): void } {
  const svg = s("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "chart", role: "group", "aria-label": t("chart") });
  const legend = h("div", { class: "legend" });
  const root = h("figure", { class: "chart-figure" }, svg, legend);
  const show = (all: Material[], chosen: string | undefined) => {
    const forms = all.filter((form) => form.error && form.bytes > 0);
    const methods = [...new Set(forms.map((form) => form.method ?? ""))].sort();
    const sizes = forms.map((form) => form.bytes);
    const errors = forms.map((form) => form.error!);
    const spread = (values: number[]) => [Math.min(...values) / 1.4, Math.max(...values) * 1.4] as const;
    const [x0, x1] = spread(sizes);
    const [y0, y1] = spread(errors);
    const x = (value: number) => FIELD.left + (Math.log(value / x0) / Math.log(x1 / x0)) * (FIELD.right - FIELD.left);
    const y = (value: number) => FIELD.bottom - (Math.log(value / y0) / Math.log(y1 / y0)) * (FIELD.bottom - FIELD.top);
    const grid = [
      ...ticks(x0, x1).flatMap((tick) => [
        s("line", { class: "grid", x1: x(tick), x2: x(tick), y1: FIELD.top, y2: FIELD.bottom }),
        s("text", { x: x(tick), y: FIELD.bottom + 16, "text-anchor": "middle" }, bytes(tick)),
      ]),
      ...ticks(y0, y1).flatMap((tick) => [
        s("line", { class: "grid", x1: FIELD.left, x2: FIELD.right, y1: y(tick), y2: y(tick) }),
        s("text", { x: FIELD.left - 8, y: y(tick) + 4, "text-anchor": "end" }, number(tick, 2)),
      ]),
      s("text", { class: "axis", x: FIELD.right, y: HEIGHT - 8, "text-anchor": "end" }, `${t("chart-bytes")} →`),
      s("text", { class: "axis", x: 8, y: HEIGHT - 8 }, `↑ ${t("chart-error")}`),
    ];
    const curves = methods.map((method, k) => {
      const own = forms.filter((form) => form.method === method).sort((a, b) => a.bytes - b.bytes);
      const points = own.map((form) => `${x(form.bytes)},${y(form.error!)}`).join(" ");
      const marks = own.map((form) => {
        const label = `${form.name}: ${bytes(form.bytes)}, ${t("error-of", { error: number(form.error!) })}`;
        const isChosen = form.id === chosen;
        const mark = s("g", { class: `point ${isChosen ? "chosen" : ""}`, tabindex: 0, role: "button", "aria-label": label, "aria-pressed": isChosen, "data-id": form.id });
        if (isChosen) mark.append(s("circle", { class: "halo", cx: x(form.bytes), cy: y(form.error!), r: 10 }));
        mark.append(s("circle", { class: "target", cx: x(form.bytes), cy: y(form.error!), r: 14 }), symbol(SHAPES[k % SHAPES.length]!, x(form.bytes), y(form.error!)), s("title", {}, label));
        mark.addEventListener("click", () => choose(form.id));
        mark.addEventListener("keydown", (event) => {
          if (event.key === "Enter" || event.key === " ") {
            event.preventDefault();
            choose(form.id);
          }
        });
        return mark;
      });
      return s("g", { class: `series s${k % 6}` }, s("polyline", { points }), ...marks);
    });
    fill(svg, ...grid, ...curves);
    fill(
      legend,
      ...methods.map((method, k) => h("span", { class: `series s${k % 6}` }, s("svg", { viewBox: "-8 -8 16 16" }, symbol(SHAPES[k % SHAPES.length]!, 0, 0)), method)),
    );
  };
  return { root, show };
}
