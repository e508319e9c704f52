/**
 * How much can be drawn while the view moves: learnt from how long frames took, so that it is right
 * for a laptop's graphics as for a workstation's. Primitives are triangles or points.
 */
const WANTED_MILLISECONDS = 30;
// Frames are seen to end at the display's own steps, so a good one may seem to take two of them.
const SLOW_MILLISECONDS = 40;
const GROWTH = 1.25;
const LEAST = 20_000;

export class Pace {
  /** Primitives that fit into a frame of a thirtieth of a second. */
  budget = Infinity;
  /** Whether there is time for more than one pixel per CSS pixel. */
  sharp = true;

  /** A frame with so many primitives took so long. */
  learn(primitives: number, milliseconds: number, pixelRatio: number): void {
    if (milliseconds <= SLOW_MILLISECONDS) {
      if (primitives * GROWTH > this.budget) this.budget *= GROWTH;
    } else if (pixelRatio > 1 && this.sharp) {
      this.sharp = false;
    } else {
      const fits = (primitives * WANTED_MILLISECONDS) / milliseconds;
      this.budget = Math.max(LEAST, Math.min(this.budget, fits));
    }
  }
}

/** Tells when the graphics card has finished what it was given, without waiting for it. */
export class FrameTimer {
  private sync: WebGLSync | null = null;
  private begun = 0;

  constructor(private readonly gl: WebGL2RenderingContext) {}

  /** Calls `tell` with the milliseconds until the commands so far are done; one at a time. */
  start(tell: (milliseconds: number) => void): void {
    const { gl } = this;
    if (this.sync || document.hidden) return;
    this.sync = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    this.begun = performance.now();
    gl.flush();
    requestAnimationFrame(() => this.look(tell));
  }

  private look(tell: (milliseconds: number) => void): void {
    const { gl, sync } = this;
    if (!sync || gl.isContextLost()) return void (this.sync = null);
    if (gl.clientWaitSync(sync, 0, 0) === gl.TIMEOUT_EXPIRED) {
      requestAnimationFrame(() => this.look(tell));
      return;
    }
    gl.deleteSync(sync);
    this.sync = null;
    // In a hidden page the steps are far apart and say nothing.
    if (!document.hidden) tell(performance.now() - this.begun);
  }
}
