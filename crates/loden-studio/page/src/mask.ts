/** Texels that are painted with a brush. A mask is a list of strokes, short enough for an address. */

export interface Stroke {
  /** Radius of the brush in texels. */
  radius: number;
  erases: boolean;
  /** Texels that the brush went through. */
  points: [number, number][];
}

/** Strokes as text: `8~12~30~14~33` is a brush of radius 8 from one texel to another, `e4~12~30` erases; `_` is between strokes. */
export function written(strokes: Stroke[]): string {
  return strokes.map(({ radius, erases, points }) => [`${erases ? "e" : ""}${radius}`, ...points.flat()].join("~")).join("_");
}

/** The strokes of a text; what is no stroke is left out. */
export function read(text: string): Stroke[] {
  return text.split("_").flatMap((part) => {
    const erases = part.startsWith("e");
    const [radius, ...numbers] = part.slice(erases ? 1 : 0).split("~").map((one) => (one === "" ? Number.NaN : Number(one)));
    const right = radius !== undefined && radius >= 0 && radius <= 4096 && numbers.length >= 2 && numbers.length % 2 === 0 && numbers.every((one) => Number.isInteger(one));
    if (!right) return [];
    const points = Array.from({ length: numbers.length / 2 }, (_, k): [number, number] => [numbers[2 * k]!, numbers[2 * k + 1]!]);
    return [{ radius: radius!, erases, points }];
  });
}

/** Adds a point to a stroke, unless it is too near to the last one to matter. */
export function extend(stroke: Stroke, [x, y]: [number, number]): boolean {
  const last = stroke.points.at(-1);
  if (last && Math.hypot(x - last[0], y - last[1]) < Math.max(1, stroke.radius / 3)) return false;
  stroke.points.push([x, y]);
  return true;
}

/** One byte for each texel: 1 where its centre is at most the radius away from a stroke. */
export function painted(strokes: Stroke[], width: number, height: number): Uint8Array {
  const mask = new Uint8Array(width * height);
  for (const { radius, erases, points } of strokes) {
    points.forEach(([x1, y1], k) => {
      const [x0, y0] = points[k - 1] ?? [x1, y1];
      const [dx, dy] = [x1 - x0, y1 - y0];
      const length = dx * dx + dy * dy;
      const last = (value: number, side: number) => Math.min(side - 1, Math.ceil(value));
      for (let y = Math.max(0, Math.floor(Math.min(y0, y1) - radius)); y <= last(Math.max(y0, y1) + radius, height); y++) {
        for (let x = Math.max(0, Math.floor(Math.min(x0, x1) - radius)); x <= last(Math.max(x0, x1) + radius, width); x++) {
          const along = length ? Math.min(1, Math.max(0, ((x - x0) * dx + (y - y0) * dy) / length)) : 0;
          if (Math.hypot(x - x0 - along * dx, y - y0 - along * dy) <= radius) mask[y * width + x] = erases ? 0 : 1;
        }
      }
    });
  }
  return mask;
}

/** How many texels are 0, then how many are not, in turn. */
export function runs(mask: Uint8Array): number[] {
  const found: number[] = [];
  let [value, count] = [0, 0];
  for (const one of mask) {
    if (one !== value) {
      found.push(count);
      [value, count] = [one, 0];
    }
    count += 1;
  }
  return [...found, count];
}
