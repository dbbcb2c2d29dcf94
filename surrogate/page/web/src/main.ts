/** The page: a body and the loads that the user drags. */

import { Clock } from "./clock";
import { readContent } from "./content";
import type { Curve } from "./curve";
import { norm } from "./mechanics/vectors";
import { Panel } from "./panel";
import { listen } from "./pointer";
import { Prediction } from "./prediction";
import { save } from "./save";
import { State } from "./state";
import { Contact } from "./touch/contact";
import { Grip } from "./touch/grip";
import { Search } from "./touch/search";
import { units } from "./units";
import { Scene } from "./view/scene";
import { movableSurface } from "./view/body_mesh";

const REST = 150; // ms without a change, after which a load on a large body rests
const LARGE = 2000; // degrees of freedom
const PREPARING = "Preparing: the body follows in a moment …";
const TORN = "No end of the time step is found. Reset brings rest.";
const STILL = 1e-6; // of the body: its largest way in a time step at rest
const PANEL = 80; // ms between two states of the panel: people read no faster

/** What scripts may use, from the console or a talk's notes. */
interface Handle {
  /** Resolves when the network is ready. */
  ready: Promise<void>;
  state: State;
  scene: Scene;
  curve: Curve;
  clock: Clock;
  /** Resolves when body and panel show the present loads. */
  settled: () => Promise<void>;
  /**
   * Times in ms to a drawn frame, once `measure` is true: from the delivery of the event to the
   * page, and from the event itself.
   */
  times: [number, number][];
  measure: boolean;
}

async function start(): Promise<void> {
  const content = await readContent();
  Object.assign(units, content.units, { negligible: 1e-12 * content.extent });
  const state = new State(content);
  const { loads } = state;
  const panel = new Panel(state, {
    changed: () => change(null),
    restarted: () => {
      prediction.restart();
      for (const search of searches) search.forget();
      again();
    },
    recoloured: () => show(),
    save: (kind) => {
      scene.drawWhole();
      void save(kind, state, scene);
    },
  });
  const scene = new Scene(state, panel.stage, panel.canvas, panel.labels);
  const surface = movableSurface(content);
  const columns = (key: number): Float64Array[] | null => prediction.responses.of(key);
  const searches = [
    new Search(
      state,
      columns,
      () => loads.all.filter((load) => load.held),
      (held) => new Grip(state, held),
    ),
    new Search(
      state,
      columns,
      () => (state.tool ? [state.tool] : []),
      ([tool]) => new Contact(state, tool, surface),
    ),
  ];
  let isBusy = false;
  let isStale = false;
  let isComplete = true;
  let isLed = false; // by a sphere or a held place, which moves
  let isPanelDue = false;
  let panelTime = 0;
  let event: { at: number; delivered: number } | null = null;
  const idle: (() => void)[] = [];
  let timer = 0;

  /** Draw the body now, and the panel a few times a second. */
  const show = (): void => {
    scene.show();
    if (isPanelDue) return;
    isPanelDue = true;
    const wait = Math.max(0, panelTime + PANEL - performance.now());
    setTimeout(() => {
      isPanelDue = false;
      panelTime = performance.now();
      panel.update(scene.largest);
    }, wait);
  };

  /** The loads have changed, by an event at a time in ms. */
  const change = (time: number | null): void => {
    for (const search of searches) search.begin();
    event = time === null ? null : { at: time, delivered: performance.now() };
    if (state.motion.isOn && isComplete) {
      show();
      clock.run();
    } else {
      again();
    }
  };

  /** Predict once more. */
  const again = (): void => {
    isStale = true;
    if (!isBusy) void predict();
  };

  const clock = new Clock(1e3 * (content.body?.motion?.step ?? 0), () => {
    if (isBusy) clock.run();
    else again();
  });

  /** The body is at the end of a time step: the next one follows, unless it is at rest. */
  const goOn = (): void => {
    prediction.goOn();
    show();
    const { pace, isDue } = clock.tick();
    state.motion.pace = pace;
    if (!isLed && state.motion.way <= STILL * content.extent) clock.rest();
    else if (isDue) isStale = true;
    else clock.run();
  };

  /** Predict and draw until nothing has changed meanwhile; say so if the network fails. */
  const predict = async (): Promise<void> => {
    isBusy = true;
    try {
      while (isStale) {
        isStale = false;
        const cause = event;
        isComplete = await predictOnce();
        if (!state.motion.isOn) show();
        if (!isComplete || !handle.measure || cause === null) continue;
        scene.finish();
        const drawn = performance.now();
        handle.times.push([drawn - cause.delivered, drawn - cause.at]);
      }
    } catch (error) {
      panel.tell(`The network failed: ${String(error)}`);
      isComplete = true;
      throw error;
    } finally {
      isBusy = false;
      if (isComplete) for (const resolve of idle.splice(0)) resolve();
    }
  };

  /**
   * Predict the fields of the present loads, and move the forces that are sought by a step; false
   * while something is missing.
   */
  const predictOnce = async (): Promise<boolean> => {
    clearTimeout(timer);
    const moves = state.motion.isOn;
    if (!moves) state.certificate = null;
    if (moves && prediction.isOver) isLed = searches.map((each) => each.goOn()).includes(true);
    const fields = await prediction.fields();
    panel.tell(fields ? "" : moves ? TORN : state.isLoaded ? PREPARING : "");
    if (!fields && moves && state.isLoaded) {
      state.unload();
      isStale = true;
    }
    if (!fields && (moves || state.isLoaded)) return moves;
    state.fields = fields;
    let outcome = searches[0].step();
    if (outcome === "there") outcome = searches[1].step();
    isStale ||= outcome === "moves";
    if (outcome === "missing") panel.tell(PREPARING);
    isStale ||= state.target !== null && state.actuated?.isWhole === false;
    if (outcome === "lost") panel.tell("No forces are found under which the body would be there.");
    if (moves) {
      if (!isStale && outcome !== "missing") goOn();
    } else if (fields) addToCurve();
    if (fields && !moves && !isStale) {
      const wait = (content.body?.order.length ?? 0) > LARGE ? REST : 0;
      timer = setTimeout(() => void rest(), wait);
    }
    return outcome !== "missing";
  };

  /** The load rests: estimate the error. */
  const rest = async (): Promise<void> => {
    if (!(await prediction.estimate())) return;
    if (content.series > 0) addToCurve();
    show();
  };

  const addToCurve = (): void => {
    const { selected } = loads;
    if (!selected) return;
    const u = norm(state.displacementAt(selected.key));
    const deviation = state.deviationAlong(selected.key);
    panel.curve.add(selected.key, norm(selected.force), u, deviation);
  };

  listen(scene, state, surface, {
    pressed: (load) => {
      panel.curve.clear();
      if (content.needsResponse && !state.motion.isOn) columns(load.key);
    },
    moved: change,
    pointed: show,
  });
  new ResizeObserver(() => {
    scene.resize();
    show();
  }).observe(panel.stage);

  const prepare = async (): Promise<void> => {
    await prediction.ready;
    performance.mark("ready");
    panel.tell("Press on the body and drag.");
    if (state.isLoaded) change(null);
  };

  const handle: Handle = {
    ready: Promise.resolve(),
    state,
    scene,
    curve: panel.curve,
    clock,
    settled: async () => {
      if (isBusy || !isComplete) await new Promise<void>((resolve) => idle.push(resolve));
      while (isPanelDue) await new Promise((resolve) => setTimeout(resolve, 1));
    },
    times: [],
    measure: false,
  };
  show();
  performance.mark("first frame");
  const prediction = new Prediction(state, () => change(null));
  handle.ready = prepare();
  Object.assign(window, { surrogatePage: handle });
  await handle.ready;
}

start().catch((error: unknown) => {
  const text = error instanceof Error ? error.message : String(error);
  document.getElementById("page")!.textContent = `The page cannot be shown: ${text}`;
  throw error;
});
