/** The two pictures of the panel for new materials: the material as it is, and what comes of it. */

import { origins, picture, Scrub, type Texels, texels } from "../api";
import { Pairs } from "../directions";
import { fill, h } from "../dom";
import { type Material, model } from "../model";
import { state } from "../state";
import { t } from "../texts";
import { Linked, type Pointed, texture, type Texture, zoomer } from "../texture";
import { button, report } from "../widgets";
import { go } from "./common";

export interface Shown {
  root: HTMLElement;
  image: Texture;
  texels: Texels | null;
  material(material: Material | undefined): void;
  /** Shows a picture that is no file yet. `pick` is told of clicks in it. */
  live(texels: Texels, caption: string, pick?: (texel: Pointed) => void): void;
}

/** The image of a material from the front under light from the side. */
export async function frontal(material: Material): Promise<Texels> {
  const pairs = new Pairs(await model.detailsOf(material.id));
  const [v, l] = pairs.nearest([0, 0], [45, 120]);
  return texels("image", { m: material.id, ...pairs.query(v, l) });
}

/** A picture under its title. `pick` is told of clicks on texels of a material, `ready` when its image is there. */
export function shown(title: string, hint: string, isResult: boolean, pick?: (texel: Pointed) => void, ready?: () => void): Shown {
  const linked = new Linked();
  let live: ((texel: Pointed) => void) | undefined;
  const image = texture(linked, title, (texel) => (drawn ? pick?.(texel) : live?.(texel)));
  const caption = h("span", { class: "ellipsis" }, "");
  const actions = h("span", { class: "row" });
  const note = h("p", { class: "hint center overlay" }, hint);
  const root = h(
    "div",
    { class: "viewer" },
    h("header", { class: "bar-line" }, h("strong", {}, title), caption, h("span", { class: "grow" }), actions, zoomer(linked)),
    h("div", { class: "stage-place" }, image.root, note),
  );
  const scrub = new Scrub();
  let drawn = "";
  const one: Shown = {
    root,
    image,
    texels: null,
    material(material) {
      caption.textContent = material?.name ?? "";
      note.hidden = Boolean(material);
      const key = material ? `${material.id} ${material.modified}` : "";
      if (key === drawn && (key || !one.texels)) return;
      drawn = key;
      one.texels = null;
      image.root.dataset.wanted = key;
      linked.fit();
      image.draw(null);
      fill(actions, ...(material && isResult ? links(material) : []));
      if (!material) return;
      scrub.run(async () => {
        try {
          const found = await frontal(material);
          if (key !== drawn) return;
          one.texels = found;
          image.draw(found);
          linked.show();
          image.root.dataset.shown = key;
          ready?.();
        } catch (error) {
          report(error);
        }
      });
    },
    live(found, text, listen) {
      const fits = one.texels?.width === found.width && one.texels?.height === found.height;
      drawn = "";
      live = listen;
      one.texels = found;
      caption.textContent = text;
      note.hidden = true;
      fill(actions);
      image.draw(found);
      if (!fits) linked.fit();
      linked.show();
    },
  };
  return one;
}

function links(material: Material): HTMLElement[] {
  const found = [button(t("look"), () => go("originals", { m: material.id, c: undefined, how: undefined }))];
  if (material.holds === "compressed") found.push(button(t("view"), () => go("view", { m: material.id, how: undefined })));
  return found;
}

/** While the pointer is on a rearranged material, marks the texel of the sample that is copied there. */
export function follow(from: Shown, to: Shown): (sample: Material | undefined, made: Material | undefined) => void {
  let key = "";
  return (sample, made) => {
    const next = sample && made ? `${sample.id} ${made.id} ${made.modified}` : "";
    if (next === key) return;
    key = next;
    from.image.hover = null;
    to.image.mark([]);
    if (!sample || !made || made.holds !== "compressed") return;
    void (async () => {
      const [whole, own] = await Promise.all([model.detailsOf(made.id), model.detailsOf(sample.id)]);
      // of a sample that is rearranged itself, the texels are those of its own sample
      if (!whole.rearranged || own.rearranged || key !== next) return;
      const map = await origins(made.id);
      if (key !== next) return;
      from.image.hover = (texel) => {
        if (!texel) return to.image.mark([]);
        const at = 2 * (texel.y * map.width + texel.x);
        to.image.mark([{ x: map.sources[at]!, y: map.sources[at + 1]! }]);
      };
    })().catch(report);
  };
}

/** The pictures of a job, the latest one whenever there is another. */
export class JobPictures {
  private readonly scrub = new Scrub();
  private at = "";

  show(id: number, pictures: number, draw: (texels: Texels) => void): void {
    const key = `${id} ${pictures}`;
    if (!pictures || key === this.at) return;
    this.at = key;
    this.scrub.run(async () => {
      try {
        const found = await picture(`jobs/${id}/picture`, { k: pictures });
        if (this.at.startsWith(`${id} `)) draw(found);
      } catch {
        // the job has been taken off the list
      }
    });
  }

  forget(): void {
    this.at = "";
  }
}

/** Part of a picture. */
export function cropped(whole: Texels, left: number, top: number, width: number, height: number): Texels {
  const rgba = new ImageData(width, height);
  for (let y = 0; y < height; y++) {
    const from = 4 * ((top + y) * whole.width + left);
    rgba.data.set(whole.rgba.data.subarray(from, from + 4 * width), 4 * y * width);
  }
  return { ...whole, width, height, rgba };
}

/** A picture between two of the same size. */
export function between(a: Texels, b: Texels, share: number): Texels {
  const rgba = new ImageData(a.width, a.height);
  for (let k = 0; k < rgba.data.length; k++) rgba.data[k] = a.rgba.data[k]! + share * (b.rgba.data[k]! - a.rgba.data[k]!);
  return { ...a, rgba };
}

/** Chosen texel of the state. */
export function chosenTexel(): Pointed | null {
  const { x, y } = state.now;
  return x !== undefined && y !== undefined ? { x, y } : null;
}
