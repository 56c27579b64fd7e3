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
  /** Boxes around more texels, in the colours of their numbers. */
  mark(texels: Pointed[]): void;
  /** Tints texels: one byte for each, 0 where nothing is tinted. */
  tint(mask: Uint8Array | null): void;
  /** What a drag does instead of moving the image; told of texels, also of those outside. */
  tool: ((texel: Pointed, phase: "down" | "move" | "up") => void) | null;
  /** Told of the texel under the pointer. */
  hover: ((texel: Pointed | null) => void) | null;
  /** Shows only the part right of a share of the width. */
  clip(share: number | null): void;
}

/** An image in a group. `pick` is told of clicks on texels. */
export function texture(linked: Linked, label: string, pick?: (texel: Pointed) => void): Texture {
  const canvas = h("canvas", { class: "texels", role: "img", "aria-label": label });
  const tinted = h("canvas", { class: "texels tint", "aria-hidden": "true", hidden: true });
  const box = h("div", { class: "texel-box" });
  const marks = h("div", { class: "texel-marks", "aria-hidden": "true" });
  const readout = h("output", { class: "readout" });
  const stage = h("div", { class: "stage", tabindex: 0, "aria-label": `${label}. ${t("zoom-hint")}` }, canvas, tinted, marks, box, readout);
  let chosen: Pointed | null = null;
  let marked: Pointed[] = [];
  let tools = false;
  let down: { x: number; y: number; moved: boolean } | null = null;
  const context = canvas.getContext("2d", { willReadFrequently: true })!;
  const one: Texture = {
    root: stage,
    canvas,
    width: 1,
    height: 1,
    tool: null,
    hover: null,
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
    mark(texels) {
      marked = texels;
      marks.replaceChildren(...texels.map((_, k) => h("div", { class: `texel-box s${k % 6}` })));
      one.place();
    },
    tint(mask) {
      // the image may be on its way
      const fits = mask?.length === one.width * one.height;
      tinted.hidden = !fits;
      if (!mask || !fits) return;
      [tinted.width, tinted.height] = [one.width, one.height];
      const image = new ImageData(one.width, one.height);
      const word = new Uint32Array(image.data.buffer);
      // green, half covering, as bytes of a little-endian word
      mask.forEach((value, k) => (word[k] = value ? 0xa065f03c : 0));
      tinted.getContext("2d")!.putImageData(image, 0, 0);
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
      for (const layer of [canvas, tinted]) {
        layer.style.transform = `translate(${left}px, ${top}px) scale(${scale})`;
        layer.style.imageRendering = scale >= 1 ? "pixelated" : "auto";
      }
      const around = (element: HTMLElement, texel: Pointed) => {
        element.style.transform = `translate(${left + texel.x * scale}px, ${top + texel.y * scale}px)`;
        element.style.width = element.style.height = `${Math.max(scale, 3)}px`;
      };
      box.hidden = !chosen;
      if (chosen) around(box, chosen);
      marked.forEach((texel, k) => around(marks.children[k] as HTMLElement, texel));
    },
    clip(share) {
      stage.style.clipPath = share === null ? "" : `inset(0 0 0 ${100 * share}%)`;
    },
  };
  const under = (event: { clientX: number; clientY: number }): Pointed => {
    const rect = stage.getBoundingClientRect();
    const scale = one.scale();
    const x = Math.floor((event.clientX - rect.left - stage.clientWidth / 2) / scale + linked.x * one.width);
    const y = Math.floor((event.clientY - rect.top - stage.clientHeight / 2) / scale + linked.y * one.height);
    return { x, y };
  };
  const at = (event: { clientX: number; clientY: number }): Pointed | null => {
    const { x, y } = under(event);
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
    tools = one.tool !== null && !event.shiftKey;
    if (tools) return one.tool!(under(event), "down");
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
    one.hover?.(texel);
    if (tools) return one.tool?.(under(event), "move");
    if (!down) return;
    const [dx, dy] = [event.clientX - down.x, event.clientY - down.y];
    if (!down.moved && Math.hypot(dx, dy) < 4) return;
    linked.scale ||= one.fitting();
    linked.move(dx / one.scale() / one.width, dy / one.scale() / one.height);
    down = { x: event.clientX, y: event.clientY, moved: true };
  });
  stage.addEventListener("pointerup", (event) => {
    const texel = at(event);
    if (tools) one.tool?.(under(event), "up");
    tools = false;
    if (down && !down.moved && texel && pick) pick(texel);
    down = null;
  });
  stage.addEventListener("pointercancel", () => {
    if (tools) one.tool?.({ x: -1, y: -1 }, "up");
    [down, tools] = [null, false];
  });
  stage.addEventListener("pointerleave", () => {
    readout.textContent = "";
    one.hover?.(null);
  });
  stage.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (step) linked.move((24 * step[0]!) / one.scale() / one.width, (24 * step[1]!) / one.scale() / one.height);
    else if (event.key === "+" || event.key === "=") linked.zoom(1.25, one, 0, 0);
    else if (event.key === "-") linked.zoom(0.8, one, 0, 0);
    else if (event.key === "0") linked.fit();
    else if (event.key === "Enter" && pick) pick({ x: Math.min(one.width - 1, Math.floor(linked.x * one.width)), y: Math.min(one.height - 1, Math.floor(linked.y * one.height)) });
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
