
return { apparent: loden_apparent };
}

/** Reflects direct light by the material. */
class Reflection extends THREE.LightingModel {
  constructor(apparent, repeats) {
    super();
    this.apparent = apparent;
    this.repeats = repeats;
  }

  /** Finds the frame of the surface from the texture coordinates, by their derivatives in the picture. */
  start(builder) {
    const at = uv();
    const [across, along] = [cross(dFdy(positionView), normalView), cross(normalView, dFdx(positionView))];
    const [right, up] = [dFdx(at), dFdy(at)];
    const tangent = normalize(across.mul(right.x).add(along.mul(up.x))).toVar();
    const upwards = across.mul(right.y).add(along.mul(up.y));
    const bitangent = cross(normalView, tangent).mul(sign(dot(cross(normalView, tangent), upwards))).toVar();
    this.local = (w) => vec3(dot(w, tangent), dot(w, bitangent), dot(w, normalView));
    this.at = at.mul(this.repeats);
    super.start(builder);
  }

  direct({ lightDirection, lightColor, reflectedLight }) {
    const value = this.apparent(this.at, this.local(lightDirection), this.local(positionViewDirection));
    reflectedLight.directDiffuse.addAssign(lightColor.mul(value).div(Math.PI));
  }
}

/** The material. */
export class LodenMaterial extends THREE.NodeMaterial {
  constructor(textures) {
    super();
    this.lights = true;
    this.repeats = uniform(new THREE.Vector2(1, 1));
    this.apparent = functions(textures).apparent;
  }

  setupLightingModel() {
    return new Reflection(this.apparent, this.repeats);
  }
}

const FORMATS = {
  rgba16float: [Uint16Array, THREE.HalfFloatType],
  rgba8unorm: [Uint8Array, THREE.UnsignedByteType],
  rgba32float: [Float32Array, THREE.FloatType],
};

/** The textures of the folder at a URL that ends with a slash. */
export async function loadTextures(url) {
  const found = async (file) => {
    const response = await fetch(url + file);
    if (!response.ok) throw new Error(`${url}${file}: ${response.status} ${response.statusText}`);
    return response;
  };
  const { textures } = await (await found("material.json")).json();
  const loaded = textures.map(async ({ name, file, format, size, bytes }) => {
    const buffer = await (await found(file)).arrayBuffer();
    if (buffer.byteLength !== bytes) throw new Error(`${url}${file}: ${buffer.byteLength} bytes, expected ${bytes}`);
    const [Numbers, type] = FORMATS[format];
    const texture = new THREE.DataArrayTexture(new Numbers(buffer), ...size);
    Object.assign(texture, { type, format: THREE.RGBAFormat, needsUpdate: true });
    return [name, texture];
  });
  return Object.fromEntries(await Promise.all(loaded));
}

/** The material of the folder at a URL that ends with a slash. */
export async function load(url) {
  return new LodenMaterial(await loadTextures(url));
}
