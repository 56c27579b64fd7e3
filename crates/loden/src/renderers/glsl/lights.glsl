// Lights, to be included after material.glsl. A light is directional if w is 0: xyz points towards it, and its colour is the
// irradiance of a surface that faces it; or a point if w is 1, at xyz, and its colour is its intensity.
const int LODEN_MOST_LIGHTS = 16;
uniform int loden_lights;
uniform vec4 loden_places[LODEN_MOST_LIGHTS];
uniform vec3 loden_colors[LODEN_MOST_LIGHTS];

// The surroundings: a latitude-longitude picture in linear light with mip maps; z is up.
uniform sampler2D loden_surroundings;

int loden_light_count() {
    return min(loden_lights, LODEN_MOST_LIGHTS);
}

vec4 loden_light_place(int k) {
    return loden_places[k];
}

vec3 loden_light_color(int k) {
    return loden_colors[k];
}

vec3 loden_environment(vec3 direction, float solid_angle) {
    ivec2 size = textureSize(loden_surroundings, 0);
    float texels = solid_angle * float(size.x * size.y) / (4.0 * LODEN_PI);
    vec2 at = vec2(0.5 + 0.5 * atan(direction.y, direction.x) / LODEN_PI, acos(clamp(direction.z, -1.0, 1.0)) / LODEN_PI);
    return textureLod(loden_surroundings, at, 0.5 * log2(max(texels, 1.0))).xyz;
}
