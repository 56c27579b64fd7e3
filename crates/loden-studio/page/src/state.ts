/** What the page shows, all of it in its address: links, reload and the browser's own history work by it. */

export interface State {
  panel: string;
  /** The material. */
  m?: string | undefined;
  /** View and light: numbers of measured directions, or angles between them. */
  v?: number | undefined;
  l?: number | undefined;
  va?: string | undefined;
  la?: string | undefined;
  /** The chosen texel. */
  x?: number | undefined;
  y?: number | undefined;
  /** The compressed form beside the original, and how both are shown. */
  c?: string | undefined;
  how?: string | undefined;
  /** More texels, as `x,y` with spaces between. */
  pins?: string | undefined;
  /** New materials: the second material, how much of it, changes as numbers, where, rows, colour and radius, painted strokes. */
  with?: string | undefined;
  amt?: number | undefined;
  ed?: string | undefined;
  on?: string | undefined;
  rows?: string | undefined;
  near?: string | undefined;
  paint?: string | undefined;
  /** The number of the job whose pictures are shown. */
  try?: number | undefined;
  /** Surroundings of the 3D view and how they are turned. */
  env?: string | undefined;
  turn?: number | undefined;
  /** Materials of the 3D view, its object, camera, light, repeats. */
  o?: string | undefined;
  more?: string | undefined;
  cam?: string | undefined;
  key?: string | undefined;
  rep?: number | undefined;
  gl?: string | undefined;
  /** Search and order of the gallery. */
  q?: string | undefined;
  by?: string | undefined;
}

const NUMBERS = new Set(["v", "l", "x", "y", "rep", "amt", "turn", "try"]);

function read(): State {
  const [panel = "", query = ""] = location.hash.replace(/^#\/?/, "").split("?");
  const state: Record<string, unknown> = { panel: panel || "gallery" };
  for (const [name, text] of new URLSearchParams(query)) {
    if (!NUMBERS.has(name)) state[name] = text;
    else if (Number.isFinite(Number(text))) state[name] = Number(text);
  }
  return state as unknown as State;
}

function written({ panel, ...rest }: State): string {
  const query = new URLSearchParams();
  for (const [name, value] of Object.entries(rest)) if (value !== undefined && value !== "") query.set(name, String(value));
  const text = query.toString().replaceAll("%2F", "/").replaceAll("%2C", ",").replaceAll("%7E", "~");
  return `#/${panel}${text ? `?${text}` : ""}`;
}

let current = read();
let steps = 0;
let dragging = false;
const listeners: ((state: State) => void)[] = [];

function tell(): void {
  for (const listener of listeners) listener(current);
}

export const state = {
  get now(): State {
    return current;
  },
  onChange(listener: (state: State) => void): void {
    listeners.push(listener);
  },
  /** Changes a part. A step can be undone. What changes while something is dragged is one step, which ends with the first
   * change that is one by itself; what is quiet is none. */
  change(part: Partial<State>, step: boolean | "quiet" = true): void {
    const next = { ...current, ...part };
    const isNew = written(next) !== written(current);
    current = next;
    if (isNew && (dragging || step === "quiet")) {
      history.replaceState(history.state, "", written(current));
    } else if (isNew) {
      steps += 1;
      history.pushState(null, "", written(current));
    }
    if (step !== "quiet") dragging = !step;
    if (isNew) tell();
  },
  canUndo(): boolean {
    return steps > 0;
  },
  undo(): void {
    if (steps > 0) history.back();
  },
  link(): string {
    return location.origin + location.pathname + written(current);
  },
};

addEventListener("popstate", () => {
  steps = Math.max(0, steps - 1);
  dragging = false;
  current = read();
  tell();
});
