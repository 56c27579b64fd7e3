/** The planes of a compressed material as small pictures; in an index image the texels of one row light up together. */

import { get, texels, type Texels } from "./api";
import { fill, h } from "./dom";
import type { Material } from "./model";
import { number, t } from "./texts";
import { report } from "./widgets";

interface Plane {
  name: string;
  rows?: number;
  count?: number;
}

/** Components that are shown of a plane. */
const MOST = 16;

export function partsView(): { root: HTMLElement; show(form: Material | undefined, view: number): void } {
  const strip = h("div", { class: "parts" });
  const title = h("summary", {}, t("parts"));
  const root = h("details", { class: "parts-fold" }, title, h("p", { class: "hint" }, t("parts-text")), strip);
  let wanted: { form: Material; view: number } | null = null;
  let shown = "";
  const update = async () => {
    if (!wanted || !root.open) return;
    const { form, view } = wanted;
    const key = `${form.id} ${form.modified} ${view}`;
    if (key === shown) return;
    shown = key;
    try {
      const planes = await get<Plane[]>("parts", { m: form.id });
      const figures = await Promise.all(
        planes.flatMap((plane, k) =>
          Array.from({ length: plane.rows ? 1 : Math.min(plane.count ?? 0, MOST) }, async (_, component) => {
            const image = await texels("part", { m: form.id, plane: k, view, component });
            return plane.rows ? indexFigure(plane, image) : figure(`${plane.name} ${component + 1}`, canvasOf(image));
          }),
        ),
      );
      if (shown === key) fill(strip, ...figures);
    } catch (error) {
      report(error);
    }
  };
  root.addEventListener("toggle", () => void update());
  return {
    root,
    show(form, view) {
      root.hidden = !form;
      wanted = form ? { form, view } : null;
      void update();
    },
  };
}

function figure(caption: string | HTMLElement, canvas: HTMLCanvasElement): HTMLElement {
  return h("figure", { class: "part" }, canvas, h("figcaption", {}, caption));
}

function canvasOf(image: Texels): HTMLCanvasElement {
  const canvas = h("canvas", { width: image.width, height: image.height, "aria-hidden": "true" });
  canvas.getContext("2d")!.putImageData(image.rgba, 0, 0);
  return canvas;
}

/** An index image in colours of its rows. */
function indexFigure(plane: Plane, image: Texels): HTMLElement {
  const rows = new Uint16Array(image.width * image.height);
  for (let k = 0; k < rows.length; k++) rows[k] = image.rgba.data[4 * k]! + 256 * image.rgba.data[4 * k + 1]!;
  const canvas = h("canvas", { class: "index", width: image.width, height: image.height, role: "img", "aria-label": plane.name });
  const context = canvas.getContext("2d")!;
  const says = h("span", {}, `${plane.name}: ${t("rows", { rows: plane.rows ?? 0 })}`);
  const idle = says.textContent;
  const paint = (lit: number) => {
    const out = new ImageData(image.width, image.height);
    for (let k = 0; k < rows.length; k++) {
      // neighbouring numbers get colours far apart
      const hash = Math.imul(rows[k]! + 1, 0x9e3779b1) >>> 0;
      const faint = lit >= 0 && rows[k] !== lit;
      for (let c = 0; c < 3; c++) {
        const value = 60 + (((hash >>> (8 * c)) & 255) * 180) / 255;
        out.data[4 * k + c] = faint ? 30 + value / 6 : rows[k] === lit ? 255 : value;
      }
      out.data[4 * k + 3] = 255;
    }
    context.putImageData(out, 0, 0);
  };
  canvas.addEventListener("pointermove", (event) => {
    const box = canvas.getBoundingClientRect();
    const x = Math.floor(((event.clientX - box.left) / box.width) * image.width);
    const y = Math.floor(((event.clientY - box.top) / box.height) * image.height);
    const row = rows[y * image.width + x];
    if (row === undefined) return;
    const count = rows.reduce((sum, other) => sum + Number(other === row), 0);
    says.textContent = t("row-of", { row, count, share: number((100 * count) / rows.length, 2) });
    paint(row);
  });
  canvas.addEventListener("pointerleave", () => {
    says.textContent = idle;
    paint(-1);
  });
  paint(-1);
  return figure(says, canvas);
}
