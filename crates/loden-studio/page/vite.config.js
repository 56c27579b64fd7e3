import { readFileSync } from "node:fs";
import { defineConfig } from "vite";

/** The licence of three.js travels with its code. */
const licence = {
  name: "licence",
  generateBundle(_, bundle) {
    const text = readFileSync("node_modules/three/LICENSE", "utf8").trim();
    for (const chunk of Object.values(bundle)) {
      if (chunk.type === "chunk" && chunk.fileName.startsWith("three")) chunk.code = `/*! three.js\n\n${text}\n*/\n${chunk.code}`;
    }
  },
};

// Names without hashes: the server has a list of these files. The modules of three.js keep all their exports, because the
// exported materials, which the page loads later, import them by the import map.
export default defineConfig({
  plugins: [licence],
  build: {
    target: "es2023",
    modulePreload: false,
    chunkSizeWarningLimit: 2000,
    rollupOptions: {
      input: { app: "index.html", "three.webgpu": "src/three/webgpu.ts", "three.tsl": "src/three/tsl.ts" },
      preserveEntrySignatures: "strict",
      output: {
        entryFileNames: "[name].js",
        chunkFileNames: "three.js",
        assetFileNames: "app[extname]",
      },
    },
  },
});
