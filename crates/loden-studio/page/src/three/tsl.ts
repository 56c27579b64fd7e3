/** The shading language of three.js as the exported materials import it. */
export * from "three/tsl";
