/** When time steps are due: in real time, or as fast as they are computed. */

const LATEST = 50; // ms that steps may be behind the clock, and catch up
const SHARE = 0.1; // of a step in the mean of their intervals

export class Clock {
  /** Whether steps are taken when a script asks for them, and only then. */
  isByHand = false;
  private frame = 0;
  private due = 0;
  private last = 0;
  private interval: number;

  /**
   * @param step - in ms
   * @param take - take a step, unless one is being taken
   */
  constructor(
    private readonly step: number,
    private readonly take: () => void,
  ) {
    this.interval = step;
  }

  /** Take a step with a frame of the screen. */
  run(): void {
    if (this.isByHand) return;
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      if (performance.now() >= this.due) this.take();
      else this.run();
    });
  }

  /** A step is taken; seconds of the body in one of the clock, and whether the next step is due. */
  tick(): { pace: number; isDue: boolean } {
    const now = performance.now();
    const elapsed = now - this.last;
    if (this.last > 0) this.interval += SHARE * (elapsed - this.interval);
    this.last = now;
    this.due = Math.max(this.due, now - LATEST) + this.step;
    return { pace: this.step / this.interval, isDue: !this.isByHand && now >= this.due };
  }

  /** No step follows for a while. */
  rest(): void {
    this.last = 0;
  }
}
