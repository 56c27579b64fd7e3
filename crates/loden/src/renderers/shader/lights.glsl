// The radiance that a point reflects to the viewer, of all lights. The frame of the surface is its tangent (where u grows), its
// bitangent (where v grows) and its normal, unit vectors; to_viewer is one, too.
vec3 lit(vec2 uv, vec3 position, vec3 to_viewer, vec3 tangent, vec3 bitangent, vec3 normal) {
    vec3 wo = vec3(dot(to_viewer, tangent), dot(to_viewer, bitangent), dot(to_viewer, normal));
    vec3 sum = vec3(0.0);
    int count = light_count();
    for (int k = 0; k < count; k++) {
        vec4 light = light_place(k);
        vec3 to_light = light.xyz - light.w * position;
        float squared = max(dot(to_light, to_light), 1e-12);
        vec3 direction = to_light * inversesqrt(squared);
        vec3 wi = vec3(dot(direction, tangent), dot(direction, bitangent), dot(direction, normal));
        vec3 irradiance = light_color(k) * (light.w > 0.5 ? 1.0 / squared : 1.0);
        sum += irradiance * apparent(uv, wi, wo) / PI;
    }
    return sum;
}

// The radiance that a point reflects of its surroundings: the mean of count directions, spread evenly over the hemisphere. The
// surroundings are asked for the mean radiance around a direction, in the solid angle that each direction stands for.
vec3 surrounded(vec2 uv, vec3 to_viewer, vec3 tangent, vec3 bitangent, vec3 normal, int count) {
    vec3 wo = vec3(dot(to_viewer, tangent), dot(to_viewer, bitangent), dot(to_viewer, normal));
    float solid_angle = 2.0 * PI / float(count);
    vec3 sum = vec3(0.0);
    for (int k = 0; k < count; k++) {
        float z = (float(k) + 0.5) / float(count);
        float radius = sqrt(1.0 - z * z);
        float angle = 2.39996323 * float(k);
        vec3 wi = vec3(radius * cos(angle), radius * sin(angle), z);
        vec3 direction = wi.x * tangent + wi.y * bitangent + wi.z * normal;
        sum += environment(direction, solid_angle) * apparent(uv, wi, wo);
    }
    return sum * (solid_angle / PI);
}
