/* A measured material, written by loden: a surface shader in the RenderMan Shading Language. Whole numbers are floats; two or three numbers
   are a vector, four are the first row of a matrix. */

float loden_int(float x) {
    return ((x < 0) ? ceil(x) : floor(x));
}

vector loden_all(float x) {
    return vector (x, x, x);
}

float loden_at(vector a; float k) {
    return ((k < 1) ? xcomp(a) : ((k < 2) ? ycomp(a) : zcomp(a)));
}

vector loden_times_each(vector a, b) {
    return vector (xcomp(a) * xcomp(b), ycomp(a) * ycomp(b), zcomp(a) * zcomp(b));
}

vector loden_max_each(vector a, b) {
    return vector (max(xcomp(a), xcomp(b)), max(ycomp(a), ycomp(b)), max(zcomp(a), zcomp(b)));
}

vector loden_min_each(vector a, b) {
    return vector (min(xcomp(a), xcomp(b)), min(ycomp(a), ycomp(b)), min(zcomp(a), zcomp(b)));
}

vector loden_clamp_each(vector a, low, high) {
    return loden_min_each(loden_max_each(a, low), high);
}

float loden_mix(float a, b, part) {
    return a + (b - a) * part;
}

vector loden_mix_each(vector a, b; float part) {
    return a + (b - a) * part;
}

matrix loden_four(float x, y, z, w) {
    return matrix (x, y, z, w, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0);
}

vector loden_xyz(matrix a) {
    return vector (comp(a, 0, 0), comp(a, 0, 1), comp(a, 0, 2));
}

float loden_dot(matrix a, b) {
    return comp(a, 0, 0) * comp(b, 0, 0) + comp(a, 0, 1) * comp(b, 0, 1) + comp(a, 0, 2) * comp(b, 0, 2)
        + comp(a, 0, 3) * comp(b, 0, 3);
}

matrix loden_plus(matrix a, b) {
    return loden_four(comp(a, 0, 0) + comp(b, 0, 0), comp(a, 0, 1) + comp(b, 0, 1), comp(a, 0, 2) + comp(b, 0, 2),
        comp(a, 0, 3) + comp(b, 0, 3));
}

matrix loden_times(float factor; matrix a) {
    return loden_four(factor * comp(a, 0, 0), factor * comp(a, 0, 1), factor * comp(a, 0, 2), factor * comp(a, 0, 3));
}

/* A pixel of a texture by its column and row: at its centre, without a filter. Sides are powers of two, so that centres are exact. */
matrix loden_pixel(uniform string file; float column, row; uniform float columns, rows) {
    float across = (column + 0.5) / columns;
    float down = (row + 0.5) / rows;
    return loden_four(
        float texture(file[0], across, down, "width", 0, "blur", 0),
        float texture(file[1], across, down, "width", 0, "blur", 0),
        float texture(file[2], across, down, "width", 0, "blur", 0),
        float texture(file[3], across, down, "width", 0, "blur", 0));
}
