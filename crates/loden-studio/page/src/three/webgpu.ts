/** three.js as the exported materials import it. */
export * from "three/webgpu";
