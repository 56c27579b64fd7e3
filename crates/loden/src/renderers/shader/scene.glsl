// What a ray from the camera sees: a ball of radius 1, or a square of side 2, around the origin. The texture coordinate of the ball
// runs twice around its axis, z, and from its lower to its upper pole.
vec3 seen(vec3 eye, vec3 ray, float repeats, bool is_ball, vec3 background, int surroundings) {
    float middle = -dot(eye, ray);
    vec3 beside = eye + middle * ray;
    float inside = 1.0 - dot(beside, beside);
    float to_ball = middle - sqrt(max(inside, 0.0));
    float to_plane = ray.z == 0.0 ? -1.0 : -eye.z / (ray.z == 0.0 ? 1.0 : ray.z);
    float distance = is_ball ? to_ball : to_plane;
    vec3 position = eye + distance * ray;
    bool on_square = max(abs(position.x), abs(position.y)) < 1.0;
    bool hit = distance > 0.0 && (is_ball ? inside > 0.0 : on_square);
    vec3 normal = is_ball ? position * inversesqrt(max(dot(position, position), 1e-12)) : vec3(0.0, 0.0, 1.0);
    vec3 around = vec3(-normal.y, normal.x, 0.0);
    vec3 tangent = is_ball ? around * inversesqrt(max(dot(around, around), 1e-12)) : vec3(1.0, 0.0, 0.0);
    vec3 bitangent = cross(normal, tangent);
    vec2 on_ball = vec2(atan(normal.y, normal.x) / PI, 1.0 - acos(clamp(normal.z, -1.0, 1.0)) / PI);
    vec2 uv = repeats * (is_ball ? on_ball : 0.5 * position.xy);
    vec3 to_viewer = vec3(0.0) - ray;
    vec3 shown = background;
    if (hit) {
        shown = lit(uv, position, to_viewer, tangent, bitangent, normal);
        if (surroundings > 0) {
            shown += surrounded(uv, to_viewer, tangent, bitangent, normal, surroundings);
        }
    }
    return shown;
}
