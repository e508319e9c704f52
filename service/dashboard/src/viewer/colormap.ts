/** Viridis (van der Walt, Smith and Firing): even steps look even, also to the color-blind. */
const STOPS = [
  "440154", "482878", "3e4989", "31688e", "26828e", "1f9e89", "35b779", "6ece58", "b5de2b", "fde725",
].map((hex) => [0, 2, 4].map((at) => Number.parseInt(hex.slice(at, at + 2), 16) / 255));

/** sRGB shares for a share from 0 to 1. */
export function colorAt(share: number): [number, number, number] {
  const place = Math.min(1, Math.max(0, share)) * (STOPS.length - 1);
  const index = Math.min(STOPS.length - 2, Math.floor(place));
  const [from, to, mix] = [STOPS[index]!, STOPS[index + 1]!, place - index];
  const blend = (channel: number) => from[channel]! + (to[channel]! - from[channel]!) * mix;
  return [blend(0), blend(1), blend(2)];
}

export function cssColorAt(share: number): string {
  return `rgb(${colorAt(share).map((channel) => Math.round(channel * 255)).join(" ")})`;
}

const TABLE_SIZE = 512;

/** Linear colors (N, 3), normalized 16-bit, of values between `low` and `high`. */
export function colorsOf(values: Float32Array, low: number, high: number): Uint16Array {
  const table = Array.from({ length: TABLE_SIZE }, (_, i) =>
    colorAt(i / (TABLE_SIZE - 1)).map((channel) => Math.round(linear(channel) * 65535)),
  );
  const colors = new Uint16Array(values.length * 3);
  const factor = (TABLE_SIZE - 1) / (high - low || 1);
  for (let i = 0; i < values.length; i++) {
    const place = Math.min(TABLE_SIZE - 1, Math.max(0, Math.round((values[i]! - low) * factor)));
    colors.set(table[place]!, 3 * i);
  }
  return colors;
}

function linear(share: number): number {
  return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
}
