// Bundles the page into ../bundle: page.js, page.css, runtime.wasm.gz; licences.txt and sbom.cdx.json
// (CycloneDX) name what of others is in them.

import { build } from "esbuild";
import { mkdir, readdir, readFile, writeFile } from "node:fs/promises";
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
  metafile: true,
  define: { "import.meta.url": "location.href" },
  legalComments: "inline",
};

const folders = new Set(["node_modules/onnxruntime-web"]);

/** Bundle one file; return its text. */
async function bundled(file, settings = {}) {
  const result = await build({ ...common, entryPoints: [file], ...settings });
  for (const input of Object.keys(result.metafile.inputs)) {
    const found = /node_modules\/(@[^/]+\/)?[^/]+/.exec(input);
    if (found) folders.add(found[0]);
  }
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

const parts = [];
for (const folder of [...folders].sort()) {
  const at = new URL(`${folder}/`, import.meta.url);
  const text = await readFile(new URL("package.json", at), "utf8");
  const { name, version, license, homepage } = JSON.parse(text);
  const file = (await readdir(at)).find((each) => /^licen[cs]e/i.test(each));
  const said = file ? await readFile(new URL(file, at), "utf8") : `${license}: ${homepage}`;
  parts.push({ name, version, license, text: said.trim() });
}
const texts = parts.map((part) => `${part.name} ${part.version}\n\n${part.text}\n`);
const components = parts.map(({ name, version, license }) => ({
  type: "library",
  name,
  version,
  purl: `pkg:npm/${encodeURIComponent(name)}@${version}`,
  licenses: [{ license: { id: license } }],
}));
const bill = { bomFormat: "CycloneDX", specVersion: "1.5", version: 1, components };
await writeFile(new URL("licences.txt", out), texts.join(`\n${"-".repeat(80)}\n\n`));
await writeFile(new URL("sbom.cdx.json", out), `${JSON.stringify(bill, null, 2)}\n`);
