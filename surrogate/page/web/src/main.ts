/** The page: a body and the loads that the user drags. */

import { bytes, readContent } from "./content";
import type { Curve } from "./curve";
import { size } from "./loads";
import { Mechanics } from "./mechanics/mechanics";
import { Network, type Fields } from "./network";
import { Panel } from "./panel";
import { listen } from "./pointer";
import { asCsv, asNpz, asPng, download } from "./save";
import { State } from "./state";
import { Grips } from "./touch/grips";
import { Touch } from "./touch/touch";
import { useUnits } from "./units";
import { Scene } from "./view/scene";
import { movableSurface } from "./view/body_mesh";

const REST = 150; // ms without a change, after which a load on a large body rests
const LARGE = 2000; // degrees of freedom
const PREPARING = "Preparing: the body follows in a moment …";
const PANEL = 80; // ms between two states of the panel: people read no faster

/** What scripts may use, from the console or a talk's notes. */
interface Handle {
  /** Resolves when the network is ready. */
  ready: Promise<void>;
  state: State;
  scene: Scene;
  curve: Curve;
  /** Resolves when body and panel show the present loads. */
  settled: () => Promise<void>;
  /**
   * Times in ms to a drawn frame, once `measure` is true: from the delivery of the event to the
   * page, and from the event itself.
   */
  times: [number, number][];
  measure: boolean;
}

/** Extents of the body along each axis. */
function extents({ coordinates, d }: { coordinates: Float64Array; d: number }): number[] {
  return Array.from({ length: d }, (_, axis) => {
    const x = coordinates.filter((_, i) => i % d === axis);
    return x.reduce((a, b) => Math.max(a, b)) - x.reduce((a, b) => Math.min(a, b));
  });
}

async function start(): Promise<void> {
  const content = await readContent();
  const extent = Math.max(...extents(content));
  useUnits(content.units, extent);
  const state = new State(content);
  const panel = new Panel(state, {
    changed: (what) => {
      if (what === "loads") change(null);
      else show();
    },
    save: (kind) => void save(kind),
  });
  const scene = new Scene(state, panel.stage, panel.canvas, panel.labels);
  let network: Network | null = null;
  let mechanics: Mechanics | null = null;
  let isBusy = false;
  let isStale = false;
  let isComplete = true;
  let isPanelDue = false;
  let panelTime = 0;
  let event: { at: number; delivered: number } | null = null;
  let idle: (() => void)[] = [];
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
    grips.begin();
    touch.begin();
    event = time === null ? null : { at: time, delivered: performance.now() };
    isStale = true;
    if (!isBusy) void predict();
  };

  /** Predict and draw until nothing has changed meanwhile; say so if the network fails. */
  const predict = async (): Promise<void> => {
    isBusy = true;
    try {
      await predictLatest();
    } catch (error) {
      panel.tell(`The network failed: ${String(error)}`);
      isComplete = true;
      throw error;
    } finally {
      isBusy = false;
      if (isComplete) {
        for (const resolve of idle) resolve();
        idle = [];
      }
    }
  };

  const predictLatest = async (): Promise<void> => {
    while (isStale) {
      isStale = false;
      const cause = event;
      isComplete = await predictOnce();
      show();
      if (isComplete && handle.measure && cause !== null) {
        scene.finish();
        const drawn = performance.now();
        handle.times.push([drawn - cause.delivered, drawn - cause.at]);
      }
    }
  };

  /**
   * Predict the fields of the present loads, and move the forces that are sought by a step; false
   * while something is missing.
   */
  const predictOnce = async (): Promise<boolean> => {
    state.certificate = null;
    mechanics?.forget();
    clearTimeout(timer);
    const fields = await presentFields();
    panel.tell(fields || !state.isLoaded ? "" : PREPARING);
    if (!fields && state.isLoaded) return false;
    state.fields = fields;
    const gripped = await grips.step();
    const outcome = gripped === "there" ? touch.step() : gripped;
    isStale ||= outcome === "moves";
    if (outcome === "missing") panel.tell(PREPARING);
    if (outcome === "lost") panel.tell("No forces are found under which the body would be there.");
    if (!fields) return outcome !== "missing";
    addToCurve();
    if (!isStale) timer = setTimeout(rest, (content.body?.order.length ?? 0) > LARGE ? REST : 0);
    return outcome !== "missing";
  };

  /** Fields under the present loads; null for a body at rest, and while something is missing. */
  const presentFields = async (): Promise<Fields | null> => {
    if (!state.isLoaded) return null;
    return content.series > 0 ? seriesFields() : networkFields();
  };

  /** Fields of the network; null while it or a response is missing. */
  const networkFields = async (): Promise<Fields | null> => {
    const { loads, stiffness } = state;
    if (content.places) {
      const sizes = loads.sizes(content.places).map((size) => size / stiffness);
      return (await network?.predictSizes(sizes)) ?? null;
    }
    const parts = loads.parts();
    const length = content.nodes * content.d;
    const response = content.needsResponse ? (mechanics?.response(parts, length) ?? null) : null;
    if (network === null || (response === null && content.needsResponse)) {
      for (const { key } of parts) request(key);
      return null;
    }
    const softer = response?.map((value) => value / stiffness) ?? null;
    return network.predict(Float32Array.from(state.equivalent()), softer);
  };

  const request = (key: number): void => {
    mechanics?.request(key, () => state.loads.units(key));
  };

  const seriesFields = async (): Promise<Fields | null> => {
    if (mechanics === null) return null;
    return atNodes(await mechanics.series(state.loading(), content.series));
  };

  /** What is drawn of displacements of all points: those of the nodes. */
  const atNodes = (points: Float32Array): Fields => ({
    displacement: points.subarray(0, content.nodes * content.d),
  });

  /** All that is known: displacements of a series stand in front of those between the nodes. */
  const atPoints = (displacement: Float32Array): Float64Array =>
    Float64Array.from(content.series > 0 ? new Float32Array(displacement.buffer) : displacement);

  const grips = new Grips(state, extent, presentFields);
  const touch = new Touch(state, movableSurface(content), extent, (node) => {
    const key = state.loads.alone(node);
    request(key);
    return mechanics?.columnsOf(key) ?? null;
  });

  /** Of a load that rests: estimate the error; a series goes on to the equilibrium that was found. */
  const rest = (): void => {
    if (!mechanics || !content.certified || !state.displacement) return;
    mechanics.estimate(state.loading(), atPoints(state.displacement), (certificate) => {
      const { corrected } = certificate;
      state.certificate = certificate;
      if (content.series > 0 && corrected) {
        state.fields = atNodes(Float32Array.from(corrected.displacement));
        const error = corrected.error.map(
          (value, i) => value + state.displacement![i] - corrected.displacement[i],
        ); // with that of single precision
        state.certificate = { ...certificate, error };
        addToCurve();
      }
      show();
    });
  };

  const addToCurve = (): void => {
    const { selected } = state.loads;
    if (!selected) return;
    const u = size(state.displacementAt(selected.node));
    const deviation = state.deviationAlong(selected.node);
    panel.curve.add(selected.node, size(selected.force), u, deviation);
  };

  const save = async (kind: "png" | "csv" | "npz"): Promise<void> => {
    scene.drawWhole();
    const file =
      kind === "csv"
        ? asCsv(state)
        : kind === "npz"
          ? asNpz(state)
          : await asPng(state, scene.canvas, scene.largest);
    download(file, `${content.case}.${kind}`);
  };

  listen(scene, state, {
    pressed: (load) => {
      panel.curve.clear();
      if (content.needsResponse) request(load.node);
    },
    moved: change,
    pointed: show,
  });
  new ResizeObserver(() => {
    scene.resize();
    show();
  }).observe(panel.stage);

  const prepare = async (): Promise<void> => {
    const { responding, body } = content;
    if (responding) {
      mechanics = new Mechanics(responding, body, () => {
        change(null);
      });
    }
    if (document.readyState === "loading") {
      await new Promise((resolve) => {
        document.addEventListener("DOMContentLoaded", resolve, { once: true });
      });
    }
    if (content.series === 0) {
      const [model, runtime] = await Promise.all([bytes("network"), bytes("runtime")]);
      network = await Network.start(model, runtime, content.nodes, content.d);
    }
    performance.mark("ready");
    panel.tell("Press on the body and drag.");
    if (state.isLoaded) change(null);
  };

  const handle: Handle = {
    ready: Promise.resolve(),
    state,
    scene,
    curve: panel.curve,
    settled: async () => {
      if (isBusy || !isComplete) await new Promise<void>((resolve) => idle.push(resolve));
      while (isPanelDue) await new Promise((resolve) => setTimeout(resolve, 1));
    },
    times: [],
    measure: false,
  };
  show();
  performance.mark("first frame");
  handle.ready = prepare();
  Object.assign(window, { surrogatePage: handle });
  await handle.ready;
}

start().catch((error: unknown) => {
  const text = error instanceof Error ? error.message : String(error);
  document.getElementById("page")!.textContent = `The page cannot be shown: ${text}`;
  throw error;
});
