/** Asks for the API key. */
import { useEffect, useRef, useState } from "preact/hooks";
import { tryKey } from "../api/calls";
import { sentence } from "../api/http";
import { apiKey, forgetKey, keyWanted, setKey } from "../state/session";

export function KeyDialog() {
  const dialog = useRef<HTMLDialogElement>(null);
  const [key, setTyped] = useState("");
  const [remember, setRemember] = useState(false);
  const [error, setError] = useState("");
  useEffect(() => dialog.current?.showModal(), []);

  const submit = async (event: Event) => {
    event.preventDefault();
    try {
      await tryKey(key.trim());
      setKey(key.trim(), remember);
    } catch (problem) {
      setError(sentence(problem));
    }
  };
  return (
    <dialog ref={dialog} aria-labelledby="key-title" onClose={() => (keyWanted.value = false)}>
      <form onSubmit={submit}>
        <h2 id="key-title">API key</h2>
        <p class="muted">
          This server wants a key; <code>visco keys create</code> makes one. It is kept in this browser only.
        </p>
        <label class="field">
          <span class="label">Key</span>
          <input
            type="password"
            autocomplete="off"
            value={key}
            onInput={(event) => setTyped(event.currentTarget.value)}
            aria-invalid={error !== ""}
            aria-describedby="key-error"
          />
        </label>
        <label class="check">
          <input type="checkbox" checked={remember} onChange={(e) => setRemember(e.currentTarget.checked)} />
          Remember it on this device
        </label>
        <p id="key-error" class="error" role="alert">
          {error}
        </p>
        <div class="row">
          <button class="button primary" disabled={key.trim() === ""}>
            Use this key
          </button>
          {apiKey.value && (
            <button type="button" class="button" onClick={() => { forgetKey(); dialog.current?.close(); }}>
              Forget the key
            </button>
          )}
          {apiKey.value && (
            <button type="button" class="button quiet" onClick={() => dialog.current?.close()}>
              Close
            </button>
          )}
        </div>
      </form>
    </dialog>
  );
}
