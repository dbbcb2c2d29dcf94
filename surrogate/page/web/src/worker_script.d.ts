declare module "worker-script" {
  /** The bundled script of the worker (bundle.mjs). */
  const script: string;
  export default script;
}
