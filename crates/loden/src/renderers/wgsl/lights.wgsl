// Lights, to be included after material.wgsl. A light is directional if w is 0: xyz points towards it, and its colour is the
// irradiance of a surface that faces it; or a point if w is 1, at xyz, and its colour is its intensity.
const LODEN_MOST_LIGHTS: i32 = 16;

struct LodenLights {
    places: array<vec4f, LODEN_MOST_LIGHTS>,
    colors: array<vec4f, LODEN_MOST_LIGHTS>,
    count: i32,
}

@group(1) @binding(0) var<uniform> loden_lights: LodenLights;

// The surroundings: a latitude-longitude picture in linear light with mip maps; z is up.
@group(1) @binding(1) var loden_surroundings: texture_2d<f32>;
@group(1) @binding(2) var loden_sampler: sampler;

fn loden_light_count() -> i32 {
    return min(loden_lights.count, LODEN_MOST_LIGHTS);
}

fn loden_light_place(k: i32) -> vec4f {
    return loden_lights.places[k];
}

fn loden_light_color(k: i32) -> vec3f {
    return loden_lights.colors[k].xyz;
}

fn loden_environment(direction: vec3f, solid_angle: f32) -> vec3f {
    let size = vec2f(textureDimensions(loden_surroundings));
    let texels = solid_angle * size.x * size.y / (4.0 * LODEN_PI);
    let at = vec2f(0.5 + 0.5 * atan2(direction.y, direction.x) / LODEN_PI, acos(clamp(direction.z, -1.0, 1.0)) / LODEN_PI);
    return textureSampleLevel(loden_surroundings, loden_sampler, at, 0.5 * log2(max(texels, 1.0))).xyz;
}
