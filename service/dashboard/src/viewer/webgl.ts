/** Whether this browser can draw the viewer. Kept apart so that asking does not load it. */
let answer: boolean | undefined;

export function hasWebgl(): boolean {
  if (answer === undefined) {
    const context = document.createElement("canvas").getContext("webgl2");
    answer = context !== null;
    context?.getExtension("WEBGL_lose_context")?.loseContext();
  }
  return answer;
}
