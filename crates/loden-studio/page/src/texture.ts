/** Images of texels that can be zoomed to single ones; several move together. */

import type { Texels } from "./api";
import { button, } from "./widgets";
import { h } from "./dom";
import { number, t } from "./texts";

export interface Pointed {
  x: number;
  y: number;
}

/** Where a group of images is looked at: texels at the centre, and pixels of the screen per texel; 0 fits them. */
export class Linked {
  scale = 0;
  x = 0.5;
  y = 0.5;
  images: Texture[] = [];

  show(): void {
    for (const image of this.images) image.place();
  }

  fit(): void {
    [this.scale, this.x, this.y] = [0, 0.5, 0.5];
    this.show();
  }

  zoom(factor: number, image: Texture, atX: number, atY: number): void {
    const before = image.scale();
    const after = Math.min(64, Math.max(image.fitting() * 0.5, before * factor));
    // the texel under the pointer stays there
    this.x += (atX * (1 / before - 1 / after)) / image.width;
    this.y += (atY * (1 / before - 1 / after)) / image.height;
    this.scale = after;
    this.clamp();
    this.show();
  }

  move(dx: number, dy: number): void {
    this.x -= dx;
    this.y -= dy;
    this.clamp();
    this.show();
  }

  private clamp(): void {
    this.x = Math.min(1, Math.max(0, this.x));
    this.y = Math.min(1, Math.max(0, this.y));
  }
}

export interface Texture {
  root: HTMLElement;
  canvas: HTMLCanvasElement;
  width: number;
  height: number;
  draw(texels: Texels | null): void;
  choose(texel: Pointed | null): void;
  place(): void;
  scale(): number;
  fitting(): number;
  /** Shows only the part right of a share of the width. */
  clip(share: number | null): void;
}

/** An image in a group. `pick` is told of clicks on texels. */
export function texture(linked: Linked, label: string, pick?: (texel: Pointed) => void): Texture {
  const canvas = h("canvas", { class: "texels", role: "img", "aria-label": label });
  const box = h("div", { class: "texel-box" });
  const readout = h("output", { class: "readout" });
  const stage = h("div", { class: "stage", tabindex: 0, "aria-label": `${label}. ${t("zoom-hint")}` }, canvas, box, readout);
  let chosen: Pointed | null = null;
  let down: { x: number; y: number; moved: boolean } | null = null;
  const context = canvas.getContext("2d", { willReadFrequently: true })!;
  const one: Texture = {
    root: stage,
    canvas,
    width: 1,
    height: 1,
    draw(texels) {
      stage.classList.toggle("blank", !texels);
      if (!texels) return;
      if (canvas.width !== texels.width || canvas.height !== texels.height) {
        [canvas.width, canvas.height] = [texels.width, texels.height];
        [one.width, one.height] = [texels.width, texels.height];
        one.place();
      }
      context.putImageData(texels.rgba, 0, 0);
    },
    choose(texel) {
      chosen = texel;
      one.place();
    },
    fitting() {
      return Math.min(stage.clientWidth / one.width, stage.clientHeight / one.height) || 1;
    },
    scale() {
      return linked.scale || one.fitting();
    },
    place() {
      const scale = one.scale();
      const left = stage.clientWidth / 2 - linked.x * one.width * scale;
      const top = stage.clientHeight / 2 - linked.y * one.height * scale;
      canvas.style.transform = `translate(${left}px, ${top}px) scale(${scale})`;
      canvas.style.imageRendering = scale >= 1 ? "pixelated" : "auto";
      box.hidden = !chosen;
      if (chosen) {
        box.style.transform = `translate(${left + chosen.x * scale}px, ${top + chosen.y * scale}px)`;
        box.style.width = box.style.height = `${Math.max(scale, 3)}px`;
      }
    },
    clip(share) {
      stage.style.clipPath = share === null ? "" : `inset(0 0 0 ${100 * share}%)`;
    },
  };
  const at = (event: { clientX: number; clientY: number }): Pointed | null => {
    const rect = stage.getBoundingClientRect();
    const scale = one.scale();
    const x = Math.floor((event.clientX - rect.left - stage.clientWidth / 2) / scale + linked.x * one.width);
    const y = Math.floor((event.clientY - rect.top - stage.clientHeight / 2) / scale + linked.y * one.height);
    return x >= 0 && y >= 0 && x < one.width && y < one.height ? { x, y } : null;
  };
  stage.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const rect = stage.getBoundingClientRect();
      const pixels = event.deltaMode === 1 ? 16 * event.deltaY : event.deltaY;
      linked.zoom(Math.exp(-pixels / 300), one, event.clientX - rect.left - rect.width / 2, event.clientY - rect.top - rect.height / 2);
    },
    { passive: false },
  );
  stage.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || event.target instanceof HTMLButtonElement) return;
    stage.setPointerCapture(event.pointerId);
    down = { x: event.clientX, y: event.clientY, moved: false };
  });
  stage.addEventListener("pointermove", (event) => {
    const texel = at(event);
    if (texel) {
      const [r, g, b] = context.getImageData(texel.x, texel.y, 1, 1).data;
      readout.textContent = `${texel.x}, ${texel.y}   ${r} ${g} ${b}`;
    } else {
      readout.textContent = "";
    }
    if (!down) return;
    const [dx, dy] = [event.clientX - down.x, event.clientY - down.y];
    if (!down.moved && Math.hypot(dx, dy) < 4) return;
    linked.scale ||= one.fitting();
    linked.move(dx / one.scale() / one.width, dy / one.scale() / one.height);
    down = { x: event.clientX, y: event.clientY, moved: true };
  });
  stage.addEventListener("pointerup", (event) => {
    const texel = at(event);
    if (down && !down.moved && texel && pick) pick(texel);
    down = null;
  });
  stage.addEventListener("pointercancel", () => (down = null));
  stage.addEventListener("pointerleave", () => (readout.textContent = ""));
  stage.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (step) linked.move((24 * step[0]!) / one.scale() / one.width, (24 * step[1]!) / one.scale() / one.height);
    else if (event.key === "+" || event.key === "=") linked.zoom(1.25, one, 0, 0);
    else if (event.key === "-") linked.zoom(0.8, one, 0, 0);
    else if (event.key === "0") linked.fit();
    else return;
    event.preventDefault();
  });
  new ResizeObserver(() => one.place()).observe(stage);
  linked.images.push(one);
  return one;
}

/** Zoom buttons for a group of images. */
export function zoomer(linked: Linked): HTMLElement {
  const level = h("output", { class: "angles" });
  const root = h("div", { class: "zoomer" }, level, button("", () => linked.fit(), { kind: "quiet", icon: "fit", title: `${t("fit")} (0)` }));
  const first = () => linked.images[0];
  const show = linked.show.bind(linked);
  linked.show = () => {
    show();
    const image = first();
    level.textContent = image ? `${number(100 * image.scale(), 3)} %` : "";
  };
  return root;
}
