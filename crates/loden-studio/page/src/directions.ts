/** The measured pairs of a BTF, as two pickers show them: a list of views, and for each view its lights. */

import type { Angles } from "./hemisphere";
import { hemisphere, type Hemisphere } from "./hemisphere";
import type { Details } from "./model";
import { state } from "./state";
import { t } from "./texts";

export class Pairs {
  readonly views: Angles[];
  private readonly lightsOfView: number[][];
  private readonly missingOfView = new Map<number, Set<number>>();

  constructor(readonly details: Details) {
    const views = details.view_degrees ?? [];
    const lights = details.light_degrees ?? [];
    if (details.listed) {
      // a BTF with its own list of pairs: a light for each image, and the view that it is seen from
      const numbers = new Map<string, number>();
      this.views = [];
      this.lightsOfView = [];
      views.forEach((view, pair) => {
        const key = view.map((angle) => angle.toFixed(2)).join();
        if (!numbers.has(key)) {
          numbers.set(key, this.views.length);
          this.views.push(view);
          this.lightsOfView.push([]);
        }
        this.lightsOfView[numbers.get(key)!]!.push(pair);
      });
    } else {
      this.views = views;
      const all = lights.map((_, k) => k);
      this.lightsOfView = views.map(() => all);
    }
    for (const [view, light] of details.missing ?? []) {
      if (!this.missingOfView.has(view)) this.missingOfView.set(view, new Set());
      this.missingOfView.get(view)!.add(light);
    }
  }

  /** Numbers of the lights of a view, as requests name them. */
  lights(view: number): number[] {
    return this.lightsOfView[view] ?? [];
  }

  angles(light: number): Angles {
    return this.details.light_degrees?.[light] ?? [0, 0];
  }

  isMissing(view: number, light: number): boolean {
    return this.missingOfView.get(view)?.has(light) ?? false;
  }

  missing(view: number): Set<number> {
    return this.missingOfView.get(view) ?? new Set();
  }

  /** What a request for an image asks for. */
  query(view: number, light: number): { view: number; light: number } {
    return { view: this.details.listed ? 0 : view, light };
  }

  /** The pair nearest to these directions. */
  nearest(view: Angles, light: Angles): [number, number] {
    const v = nearestOf(this.views, view);
    const lights = this.lights(v);
    return [v, lights[nearestOf(lights.map((k) => this.angles(k)), light)] ?? 0];
  }
}

function nearestOf(all: Angles[], to: Angles): number {
  const unit = ([theta, phi]: Angles) => {
    const [a, b] = [(theta * Math.PI) / 180, (phi * Math.PI) / 180];
    return [Math.sin(a) * Math.cos(b), Math.sin(a) * Math.sin(b), Math.cos(a)] as const;
  };
  const [x, y, z] = unit(to);
  let best = 0;
  let most = -Infinity;
  all.forEach((angles, k) => {
    const [a, b, c] = unit(angles);
    const cosine = a * x + b * y + c * z;
    if (cosine > most + 1e-9) [best, most] = [k, cosine];
  });
  return best;
}

/** Directions that show most of a material at first. */
const FIRST: [Angles, Angles] = [[0, 0], [45, 120]];

/** Two pickers that write what they pick into the state. */
export class Pickers {
  readonly light: Hemisphere;
  readonly view: Hemisphere;
  private pairs: Pairs | null = null;
  private offered = -1;

  constructor() {
    this.light = hemisphere(t("light"), (index, angles, done) => {
      if (!this.pairs) return;
      const l = this.pairs.lights(this.now()[0])[index];
      state.change(state.now.how === "between" ? { la: angles.join() } : { l }, done);
    });
    this.view = hemisphere(t("viewer"), (index, angles, done) => {
      if (!this.pairs) return;
      if (state.now.how === "between") return state.change({ va: angles.join() }, done);
      const [v, l] = this.pairs.nearest(this.pairs.views[index]!, this.pairs.angles(this.now()[1]));
      state.change({ v, l }, done);
    });
  }

  /** The chosen pair. */
  now(): [number, number] {
    if (!this.pairs) return [0, 0];
    const { v, l } = state.now;
    const fallback = this.pairs.nearest(...FIRST);
    const view = v !== undefined && v >= 0 && v < this.pairs.views.length ? v : fallback[0];
    const light = l !== undefined && this.pairs.lights(view).includes(l) ? l : this.pairs.nearest(this.pairs.views[view] ?? [0, 0], FIRST[1])[1];
    return [view, light];
  }

  /** Directions between measured ones. */
  between(): { view: Angles; light: Angles } {
    const [v, l] = this.now();
    const parsed = (text: string | undefined, fallback: Angles): Angles => {
      const numbers = (text ?? "").split(",").map(Number);
      return numbers.length === 2 && numbers.every(Number.isFinite) ? [Math.min(90, Math.max(0, numbers[0]!)), numbers[1]!] : fallback;
    };
    return { view: parsed(state.now.va, this.pairs?.views[v] ?? [0, 0]), light: parsed(state.now.la, this.pairs?.angles(l) ?? [0, 0]) };
  }

  show(pairs: Pairs): void {
    if (pairs !== this.pairs) {
      this.pairs = pairs;
      this.offered = -1;
      this.view.offer(pairs.views, new Set());
    }
    const [v, l] = this.now();
    const lights = pairs.lights(v);
    if (this.offered !== v) {
      this.offered = v;
      const missing = pairs.missing(v);
      this.light.offer(lights.map((k) => pairs.angles(k)), new Set(lights.flatMap((k, at) => (missing.has(k) ? [at] : []))));
    }
    const free = state.now.how === "between";
    this.light.free(free);
    this.view.free(free);
    if (free) {
      const { view, light } = this.between();
      this.view.point(view);
      this.light.point(light);
    } else {
      this.view.choose(v);
      this.light.choose(lights.indexOf(l));
    }
  }
}
