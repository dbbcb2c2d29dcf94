// Bundles the page into ../bundle: page.js, page.css, runtime.wasm.gz.

import { build } from "esbuild";
import { mkdir, readFile, writeFile } from "node:fs/promises";
import { gzipSync } from "node:zlib";

const out = new URL("../bundle/", import.meta.url);
const runtime = new URL(
  "node_modules/onnxruntime-web/dist/ort-wasm-simd-threaded.wasm",
  import.meta.url,
);
const common = {
  absWorkingDir: new URL(".", import.meta.url).pathname,
  bundle: true,
  format: "iife",
  minify: true,
  target: "es2022",
  write: false,
  define: { "import.meta.url": "location.href" },
  legalComments: "inline",
};

/** Bundle one file; return its text. */
async function bundled(file, settings = {}) {
  const result = await build({ ...common, entryPoints: [file], ...settings });
  return result.outputFiles[0].text;
}

const worker = await bundled("src/mechanics/worker.ts");
const workerAsText = {
  name: "worker as text",
  setup(builder) {
    builder.onResolve({ filter: /^worker-script$/ }, () => ({ path: "worker", namespace: "text" }));
    builder.onLoad({ filter: /.*/, namespace: "text" }, () => ({
      contents: worker,
      loader: "text",
    }));
  },
};
const page = await bundled("src/main.ts", {
  plugins: [workerAsText],
  alias: { "onnxruntime-web/wasm": "./node_modules/onnxruntime-web/dist/ort.wasm.bundle.min.mjs" },
});
const style = await bundled("src/page.css");
for (const text of [page, style]) {
  if (/<\/(script|style)/i.test(text)) throw new Error("the bundle would end its HTML element");
}

await mkdir(out, { recursive: true });
await writeFile(new URL("page.js", out), page);
await writeFile(new URL("page.css", out), style);
await writeFile(new URL("runtime.wasm.gz", out), gzipSync(await readFile(runtime), { level: 9 }));
