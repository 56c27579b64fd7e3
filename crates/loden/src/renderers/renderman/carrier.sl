
/* The number of a pixel, bit for bit: alpha, red, green and blue are its bytes, from its sign on. */
float loden_float(matrix pixel) {
    float red = round(255 * comp(pixel, 0, 0));
    float green = round(255 * comp(pixel, 0, 1));
    float blue = round(255 * comp(pixel, 0, 2));
    float alpha = round(255 * comp(pixel, 0, 3));
    float is_negative = floor(alpha / 128);
    float is_odd = floor(red / 128);
    float exponent = 2 * (alpha - 128 * is_negative) + is_odd;
    float significand = (red - 128 * is_odd) * 65536 + green * 256 + blue;
    significand = ((exponent == 0) ? 2 * significand : significand + 8388608);
    return (1 - 2 * is_negative) * (significand / 8388608) * pow(2, exponent - 127);
}

float loden_carried(uniform string file; float column, row; uniform float columns, rows) {
    return loden_float(loden_pixel(file, column, row, columns, rows));
}

matrix loden_exact(uniform string numbers, indices, directions; float address) {
    float row = floor(address / {directions_COLUMNS});
    float column = 4 * (address - row * {directions_COLUMNS});
    return loden_four(
        loden_carried(directions, column, row, 4 * {directions_COLUMNS}, {directions_LINES}),
        loden_carried(directions, column + 1, row, 4 * {directions_COLUMNS}, {directions_LINES}),
        loden_carried(directions, column + 2, row, 4 * {directions_COLUMNS}, {directions_LINES}),
        loden_carried(directions, column + 3, row, 4 * {directions_COLUMNS}, {directions_LINES}));
}
