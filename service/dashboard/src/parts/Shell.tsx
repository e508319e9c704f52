/** What surrounds every page: navigation, worker state, connection, notes. */
import type { ComponentChildren } from "preact";
import { useEffect, useState } from "preact/hooks";
import { droppedFiles, sortFiles } from "../logic/files";
import { online } from "../state/connection";
import { choose } from "../state/intake";
import { info } from "../state/jobs";
import { navigate, path, query } from "../state/route";
import { apiKey, keyWanted } from "../state/session";
import { isDark, toggleTheme } from "../state/theme";
import { dismiss, say, toasts } from "../state/toasts";
import { Icon } from "./Icon";
import { KeyDialog } from "./KeyDialog";

export function Shell({ children, wide }: { children: ComponentChildren; wide: boolean }) {
  return (
    <>
      <a class="skip" href="#main">
        Skip to the content
      </a>
      <header class="topbar">
        <a class="brand" href="/" aria-label="VisCo, all jobs">
          <img src="/icon.svg" alt="" />
          <span>VisCo</span>
        </a>
        <nav aria-label="Main">
          <NavLink to="/">Jobs</NavLink>
          <NavLink to="/new">New job</NavLink>
        </nav>
        <div class="grow" />
        <Workers />
        {(apiKey.value || info.value?.keys_needed) && (
          <button class="button quiet icon-only" aria-label="API key" onClick={() => (keyWanted.value = true)}>
            <Icon name="key" />
          </button>
        )}
        <button
          class="button quiet icon-only"
          aria-label={isDark.value ? "Use light colors" : "Use dark colors"}
          onClick={toggleTheme}
        >
          <Icon name={isDark.value ? "sun" : "moon"} />
        </button>
      </header>
      <div role="status">
        {!online.value && (
          <p class="offline">The server cannot be reached. This page goes on by itself when it is back.</p>
        )}
      </div>
      <main id="main" class={wide ? "wide" : ""} tabIndex={-1}>
        {children}
      </main>
      <Toasts />
      <DropTarget />
      {keyWanted.value && <KeyDialog />}
    </>
  );
}

function NavLink({ to, children }: { to: string; children: string }) {
  return (
    <a href={to} aria-current={path.value === to ? "page" : undefined}>
      {children}
    </a>
  );
}

function Workers() {
  const now = info.value;
  if (!now) return null;
  const count = now.workers.length;
  const state = count === 0 ? "bad" : now.running > 0 ? "busy" : "good";
  const workers = count === 0 ? "No worker" : count === 1 ? "1 worker" : `${count} workers`;
  const load = [
    now.running > 0 ? `${now.running} running` : "",
    now.queued > 0 ? `${now.queued} queued` : "",
  ].filter(Boolean);
  return (
    <p class="workers" title={now.workers.map((one) => `${one.id}: ${one.device}`).join("\n")}>
      <span class={`dot ${state}`} />
      {workers}
      <span class="detail">{load.join(", ") || (count > 0 ? "idle" : "jobs will wait")}</span>
    </p>
  );
}

function Toasts() {
  return (
    <div class="toasts" role="status">
      {toasts.value.map((toast) => (
        <div key={toast.id} class={`toast ${toast.tone}`}>
          <span class="grow">{toast.text}</span>
          {toast.undo ? (
            <button class="button" onClick={toast.undo}>
              Undo
            </button>
          ) : (
            <button class="button icon-only" aria-label="Dismiss" onClick={() => dismiss(toast.id)}>
              <Icon name="close" />
            </button>
          )}
        </div>
      ))}
    </div>
  );
}

/** Files can be dropped anywhere; they land on the page for a new job. */
function DropTarget() {
  const [over, setOver] = useState(false);
  useEffect(() => {
    let hiding = 0;
    const isFiles = (event: DragEvent) => event.dataTransfer?.types.includes("Files") ?? false;
    const show = (event: DragEvent) => {
      if (!isFiles(event)) return;
      event.preventDefault();
      setOver(true);
      // A drag that ends elsewhere does not always say so; while it lasts it keeps calling.
      clearTimeout(hiding);
      hiding = window.setTimeout(hide, 1000);
    };
    const hide = () => {
      clearTimeout(hiding);
      setOver(false);
    };
    const leave = (event: DragEvent) => event.relatedTarget === null && hide();
    const drop = (event: DragEvent) => {
      if (!event.dataTransfer || !isFiles(event)) return;
      event.preventDefault();
      hide();
      droppedFiles(event.dataTransfer).then(takeFiles, () => say("What was dropped could not be read.", "bad"));
    };
    const handlers = { dragenter: show, dragover: show, dragleave: leave, drop } as const;
    for (const [name, handler] of Object.entries(handlers)) addEventListener(name, handler as EventListener);
    return () => {
      for (const [name, handler] of Object.entries(handlers)) removeEventListener(name, handler as EventListener);
    };
  }, []);
  return over ? <div class="dropping">Drop scans or folders to reconstruct them</div> : null;
}

export function takeFiles(files: Iterable<File>): void {
  const { scans, others } = sortFiles(files);
  if (others > 0) say(`${others} ${others === 1 ? "file is" : "files are"} no scan and left out.`);
  else if (scans.length === 0) say("There is no scan in it.");
  if (scans.length === 0) return;
  choose(scans);
  // Settings that were already chosen there are kept.
  const isThere = path.peek() === "/new" && !query.peek().has("retry");
  if (!isThere) navigate("/new");
}
