/** Small line drawings; always beside a text or a label, so they are hidden from readers. */
const PATHS = {
  plus: "M8 3v10M3 8h10",
  sun: "M8 5.2a2.8 2.8 0 1 1 0 5.6 2.8 2.8 0 0 1 0-5.6M8 1.5v1M8 13.5v1M1.5 8h1M13.5 8h1M3.4 3.4l.7.7M11.9 11.9l.7.7M12.6 3.4l-.7.7M4.1 11.9l-.7.7",
  moon: "M13 9.6A5.6 5.6 0 0 1 6.4 3 5.6 5.6 0 1 0 13 9.6",
  key: "M9.7 6.3a3 3 0 1 1-.8 2.9L3 15M5 13l1.5 1.5M7 11l1 1M9.7 6.3 9.5 6.5",
  close: "M4 4l8 8M12 4l-8 8",
  down: "M8 2.5v8M4.8 7.5 8 10.7l3.2-3.2M3 13.5h10",
  copy: "M6 6h7v7H6zM3 10V3h7",
  camera: "M2 5h3l1.2-1.7h3.6L11 5h3v8H2zM8 6.7a2.2 2.2 0 1 1 0 4.4 2.2 2.2 0 0 1 0-4.4",
  ruler: "M2.5 10.5l8-8 3 3-8 8zM5 8l1.2 1.2M7 6l1.2 1.2M9 4l1.2 1.2",
  fit: "M8 5.4a2.6 2.6 0 1 1 0 5.2 2.6 2.6 0 0 1 0-5.2M8 1.5v2.4M8 12.1v2.4M1.5 8h2.4M12.1 8h2.4",
  whole: "M3 3h3M3 3v3M13 3h-3M13 3v3M3 13h3M3 13v-3M13 13h-3M13 13v-3",
  upload: "M8 11V3M4.8 6.2 8 3l3.2 3.2M3 13.5h10",
  retry: "M12.8 6A5 5 0 1 0 13 9M13 2.5V6H9.5",
  trash: "M3 4.5h10M6.5 4.5V3h3v1.5M4.5 4.5l.6 8.5h5.8l.6-8.5",
  columns: "M2.5 3h11v10h-11zM8 3v10",
  search: "M7 2.8a4.2 4.2 0 1 1 0 8.4 4.2 4.2 0 0 1 0-8.4M10.2 10.2 13.5 13.5",
  cube: "M8 1.8 13.5 5v6L8 14.2 2.5 11V5zM2.5 5 8 8.1 13.5 5M8 8.1v6.1",
  folder: "M2 4h4l1.5 1.7H14V13H2z",
} as const;

export type IconName = keyof typeof PATHS;

export function Icon({ name }: { name: IconName }) {
  return (
    <svg class="icon" viewBox="0 0 16 16" aria-hidden="true">
      <path d={PATHS[name]} />
    </svg>
  );
}
