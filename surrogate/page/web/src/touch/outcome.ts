/** What a frame has done for forces that are sought. */

/**
 * The body is where it shall be; it moves there; responses are being computed; no forces are found.
 */
export type Outcome = "there" | "moves" | "missing" | "lost";
