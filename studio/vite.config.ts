import { readFileSync } from "node:fs";
import { resolve } from "node:path";
import { defineConfig, type Plugin } from "vite";

const BUNDLED = ["three", "three-mesh-bvh"];

/** The licences of what the bundle holds, in a file beside it. */
function licences(): Plugin {
  return {
    name: "licences",
    generateBundle() {
      const texts = BUNDLED.map((name) => `${name}\n\n${readFileSync(resolve("node_modules", name, "LICENSE"), "utf8").trim()}\n`);
      this.emitFile({ type: "asset", fileName: "licences.txt", source: texts.join("\n----\n\n") });
    },
  };
}

export default defineConfig({
  base: "/static/",
  plugins: [licences()],
  build: {
    target: "es2022",
    outDir: "../src/morphlet/studio/static",
    emptyOutDir: true,
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 1500,
  },
});
