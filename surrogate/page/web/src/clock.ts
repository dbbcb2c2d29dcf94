/** When time steps are due: in real time, or as fast as they are computed. */

const LATEST = 50; // ms that steps may be behind the clock, and catch up
const PERIOD = 500; // ms that a pace is measured over

export class Clock {
  /** Whether steps are taken when a script asks for them, and only then. */
  isByHand = false;
  /** Seconds of the body in a second. */
  pace = 1;
  private frame = 0;
  private due = 0;
  private since = 0;
  private count = 0;

  /**
   * @param step - in ms
   * @param take - take a step, unless one is being taken
   */
  constructor(
    private readonly step: number,
    private readonly take: () => void,
  ) {}

  /** Take a step with a frame of the screen. */
  run(): void {
    if (this.isByHand) return;
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      if (performance.now() >= this.due) this.take();
      else this.run();
    });
  }

  /** No step follows for a while. */
  rest(): void {
    this.count = 0;
  }

  /** A step is taken; whether the next one is due at once. */
  tick(): boolean {
    const now = performance.now();
    this.due = Math.max(this.due, now - LATEST) + this.step;
    const elapsed = now - this.since;
    if (this.count > 0 && elapsed > PERIOD) this.pace = (this.count * this.step) / elapsed;
    if (this.count === 0 || elapsed > PERIOD) [this.since, this.count] = [now, 0];
    this.count++;
    return !this.isByHand && now >= this.due;
  }
}
