/** Light or dark: the system's choice unless the user has made one. */
import { effect, signal } from "@preact/signals";

export type Theme = "system" | "light" | "dark";
const NAME = "visco.theme";
const dark = matchMedia("(prefers-color-scheme: dark)");

export const theme = signal<Theme>((localStorage.getItem(NAME) as Theme | null) ?? "system");
export const isDark = signal(false);

export function installTheme(): void {
  const apply = () => {
    isDark.value = theme.value === "dark" || (theme.value === "system" && dark.matches);
    document.documentElement.dataset.theme = isDark.value ? "dark" : "light";
  };
  dark.addEventListener("change", apply);
  effect(apply);
}

export function toggleTheme(): void {
  theme.value = isDark.value ? "light" : "dark";
  localStorage.setItem(NAME, theme.value);
}
