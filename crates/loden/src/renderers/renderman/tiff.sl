
/* Four numbers by their address: along rows, then row by row. */
matrix loden_texel(uniform string file; float address; uniform float columns, rows) {
    float row = floor(address / columns);
    return loden_pixel(file, address - row * columns, row, columns, rows);
}

matrix loden_number(uniform string numbers, indices, directions; float address) {
    return loden_texel(numbers, address, {numbers_COLUMNS}, {numbers_LINES});
}

matrix loden_byte(uniform string numbers, indices, directions; float address) {
    return loden_texel(indices, address, {indices_COLUMNS}, {indices_LINES});
}

matrix loden_exact(uniform string numbers, indices, directions; float address) {
    return loden_texel(directions, address, {directions_COLUMNS}, {directions_LINES});
}
