/** Where the page is: a path and its query, moved by ordinary links. */
import { computed, signal } from "@preact/signals";

const location$ = signal(readLocation());

function readLocation(): URL {
  return new URL(typeof location === "undefined" ? "http://localhost/" : location.href);
}

export const path = computed(() => location$.value.pathname);
export const query = computed(() => location$.value.searchParams);

export type Route =
  | { page: "jobs" }
  | { page: "new" }
  | { page: "job"; id: string }
  | { page: "compare"; ids: string[] }
  | { page: "missing" };

export const route = computed<Route>(() => routeOf(path.value, query.value));

export function routeOf(pathname: string, search: URLSearchParams): Route {
  const parts = pathname.split("/").filter(Boolean);
  if (parts.length === 0) return { page: "jobs" };
  if (parts.length === 1 && parts[0] === "new") return { page: "new" };
  if (parts.length === 2 && parts[0] === "jobs" && parts[1]) return { page: "job", id: parts[1] };
  if (parts.length === 1 && parts[0] === "compare") {
    const ids = (search.get("jobs") ?? "").split(",").filter(Boolean);
    return { page: "compare", ids: [...new Set(ids)].slice(0, 4) };
  }
  return { page: "missing" };
}

let arrived = false;

/** Whether a new page was moved to since this was last asked. */
export function takeArrival(): boolean {
  const was = arrived;
  arrived = false;
  return was;
}

export function navigate(to: string): void {
  arrived = true;
  if (to !== location.pathname + location.search) history.pushState(null, "", to);
  location$.value = readLocation();
  scrollTo(0, 0);
}

/** Let links inside the page move without loading it again. */
export function installRouter(): void {
  addEventListener("popstate", () => {
    arrived = true;
    location$.value = readLocation();
  });
  document.addEventListener("click", (event) => {
    const link = (event.target as Element).closest?.("a[href]") as HTMLAnchorElement | null;
    const modified = event.metaKey || event.ctrlKey || event.shiftKey || event.altKey;
    if (!link || modified || event.button !== 0 || event.defaultPrevented) return;
    if (link.origin !== location.origin || link.target || link.hasAttribute("download")) return;
    if (/^\/(v1|docs|openapi)/.test(link.pathname)) return;
    event.preventDefault();
    navigate(link.pathname + link.search);
  });
}
