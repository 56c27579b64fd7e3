
/* The row of the block that a texel has: its high byte is green, its low byte blue. */
vector loden_row_bytes(uniform string indices; float texel) {
    float row = floor(texel / {TEXELS_WIDE});
    matrix pixel = loden_pixel(indices, texel - {TEXELS_WIDE} * row, row, {TEXEL_COLUMNS}, {TEXEL_ROWS});
    return vector (comp(pixel, 0, 2), comp(pixel, 0, 1), 0);
}

/* Four bytes of indices: of four texels, or of two. */
matrix loden_byte(uniform string numbers, indices, directions; float address) {
    uniform float each = {BYTES_OF_INDEX};
    float first = (address - {PLANE}) * 4 / each;
    float last = {TEXELS} - 1;
    vector a = loden_row_bytes(indices, min(first, last));
    vector b = loden_row_bytes(indices, min(first + 1, last));
    matrix found = loden_four(xcomp(a), ycomp(a), xcomp(b), ycomp(b));
    if (each == 1) {
        vector c = loden_row_bytes(indices, min(first + 2, last));
        vector d = loden_row_bytes(indices, min(first + 3, last));
        found = loden_four(xcomp(a), xcomp(b), xcomp(c), xcomp(d));
    }
    return found;
}

/* A colour of the block: a row for each index, a column for each pair of directions. */
matrix loden_number(uniform string numbers, indices, directions; float address) {
    float row = floor((address - {TABLE}) / {PAIRS});
    return loden_pixel(numbers, address - {TABLE} - row * {PAIRS}, row, {TABLE_COLUMNS}, {TABLE_ROWS});
}
