// A component of a vector by its number.
float component(vec4 four, int k) {
    return k < 2 ? (k == 0 ? four.x : four.y) : (k == 2 ? four.z : four.w);
}

// The weights of a direction in a cell of the sphere of directions; the cell is named by the address of its five numbers.
vec3 cell_weights(int cell, vec3 w) {
    return vec3(dot(exact(cell).xyz, w), dot(exact(cell + 1).xyz, w), dot(exact(cell + 2).xyz, w));
}

// The cell around a direction: a triangle between three sampled directions, or a sector below the measured ones. The search
// walks from a nearby cell across the edge with the most negative weight.
int find_cell(int first, int cells, vec3 w) {
    float half_side = 0.5 * float(GRID - 1);
    float last = float(GRID - 1);
    int x = int(clamp(floor(w.x * half_side + half_side + 0.5), 0.0, last));
    int y = int(clamp(floor(w.y * half_side + half_side + 0.5), 0.0, last));
    int square = y * GRID + x;
    int quarter = square / 4;
    int found = int(component(exact(first + quarter), square - 4 * quarter));
    int begin = first + GRID * GRID / 4;
    for (int step = 0; step < cells; step++) {
        vec3 b = cell_weights(begin + 5 * found, w);
        float lowest = min(b.x, min(b.y, b.z));
        vec4 next = exact(begin + 5 * found + 3);
        float beyond = b.z == lowest ? next.z : (b.y == lowest ? next.y : next.x);
        if (lowest >= -1e-6 || beyond < 0.0) {
            break;
        }
        found = int(beyond);
    }
    return begin + 5 * found;
}

// The sampled directions at the corners of a cell.
ivec3 corners(int cell) {
    return ivec3(int(exact(cell).w), int(exact(cell + 1).w), int(exact(cell + 2).w));
}

// The share of the way from the first to the second corner of a sector.
float along_edge(vec3 b) {
    return b.y / max(b.x + b.y, 1e-30);
}

// The weights of the corners of a cell.
vec3 corner_weights(int cell, vec3 w) {
    vec3 b = max(cell_weights(cell, w), vec3(0.0));
    float along = along_edge(b);
    vec3 edge = vec3(1.0 - along, along, 0.0);
    return exact(cell + 4).z > 0.5 ? edge : b / max(b.x + b.y + b.z, 1e-30);
}

// Below the measured directions, the cosine of a direction divided by that at their edge; else 1.
float fade(int cell, vec3 w) {
    vec4 edge = exact(cell + 4);
    float along = along_edge(max(cell_weights(cell, w), vec3(0.0)));
    float cosine = mix(edge.x, edge.y, along);
    float below = cosine > 1e-6 ? clamp(w.z / max(cosine, 1e-6), 0.0, 1.0) : 1.0;
    return edge.z > 0.5 ? below : 1.0;
}

// The column or row of the texel before a place along an axis, and the fraction of the way to the next; v grows upwards.
vec2 place_on_axis(float at, float size) {
    float x = (at - floor(at)) * size - 0.5;
    float cell = floor(x);
    return vec2(cell < 0.0 ? size - 1.0 : min(cell, size - 1.0), x - cell);
}

// The four texels around a texture coordinate, numbered row by row from the top left.
ivec4 texels_around(vec2 uv) {
    int x = int(place_on_axis(uv.x, float(WIDTH)).x);
    int y = int(place_on_axis(1.0 - uv.y, float(HEIGHT)).x);
    int right = x + 1 >= WIDTH ? 0 : x + 1;
    int below = y + 1 >= HEIGHT ? 0 : y + 1;
    return ivec4(y * WIDTH + x, y * WIDTH + right, below * WIDTH + x, below * WIDTH + right);
}

// Their bilinear weights.
vec4 texel_weights_around(vec2 uv) {
    float x = place_on_axis(uv.x, float(WIDTH)).y;
    float y = place_on_axis(1.0 - uv.y, float(HEIGHT)).y;
    return vec4((1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y);
}

// The mean of four coefficients over texels; each texel has groups of four from the address first on.
vec4 mean_of(int first, int groups, ivec4 texels, vec4 weights) {
    vec4 mean = weights.x * number(first + groups * texels.x);
    mean += weights.y * number(first + groups * texels.y);
    mean += weights.z * number(first + groups * texels.z);
    mean += weights.w * number(first + groups * texels.w);
    return mean;
}

// An index of one byte.
int index_8(int first, int texel) {
    int quarter = texel / 4;
    return int(component(byte(first + quarter), texel - 4 * quarter) * 255.0 + 0.5);
}

// An index of two bytes, low byte first.
int index_16(int first, int texel) {
    int pair = texel / 2;
    vec4 four = byte(first + pair);
    float low = texel == 2 * pair ? four.x : four.z;
    float high = texel == 2 * pair ? four.y : four.w;
    return int(low * 255.0 + 0.5) + 256 * int(high * 255.0 + 0.5);
}

// The half vector of two directions.
vec3 half_vector(vec3 wi, vec3 wo) {
    vec3 sum = wi + wo;
    float length_squared = dot(sum, sum);
    return length_squared > 0.0 ? sum * inversesqrt(max(length_squared, 1e-30)) : vec3(0.0, 0.0, 1.0);
}

// The light in the frame of the half vector, whose tangent is that of the surface, orthogonalised.
vec3 difference_vector(vec3 wi, vec3 wo) {
    vec3 wh = half_vector(wi, wo);
    vec3 tangent = vec3(1.0, 0.0, 0.0) - wh * wh.x;
    tangent = tangent * inversesqrt(max(dot(tangent, tangent), 1e-30));
    return vec3(dot(wi, tangent), dot(wi, cross(wh, tangent)), dot(wi, wh));
}

// The place of a direction on a square grid over the hemisphere: Lambert's projection, then the concentric map.
vec2 place_on_grid(vec3 w, float side) {
    float r = sqrt(clamp(1.0 - w.z, 0.0, 1.0));
    float major = max(abs(w.x), abs(w.y));
    float minor = min(abs(w.x), abs(w.y));
    float along = r * atan(minor / max(major, 1e-30)) / (0.25 * PI);
    float u = abs(w.x) > abs(w.y) ? r : along;
    float v = abs(w.x) > abs(w.y) ? along : r;
    vec2 square = vec2(w.x < 0.0 ? -u : u, w.y < 0.0 ? -v : v) * 0.5 + vec2(0.5);
    return clamp(square * side - vec2(0.5), vec2(0.0), vec2(side - 1.0));
}

// The first of the four nodes around a place on a grid.
ivec2 node_before(vec2 place, int side) {
    return ivec2(min(int(floor(place.x)), side - 2), min(int(floor(place.y)), side - 2));
}
