/** Which way of the scan points up; apart from the rest of the viewer, which is loaded later. */
export const UPS = ["x", "y", "z", "-x", "-y", "-z"] as const;
export type Up = (typeof UPS)[number];

export function isPositive(up: Up): boolean {
  return up.length === 1;
}

export function opposite(up: Up): Up {
  return UPS[(UPS.indexOf(up) + 3) % 6]!;
}

export function upName(up: Up): string {
  return isPositive(up) ? `+${up.toUpperCase()}` : `−${up.at(-1)!.toUpperCase()}`;
}
