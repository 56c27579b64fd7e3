
string loden_digit(uniform float digit) {
    return ((digit < 5)
        ? ((digit < 2) ? ((digit < 1) ? "0" : "1") : ((digit < 3) ? "2" : ((digit < 4) ? "3" : "4")))
        : ((digit < 7) ? ((digit < 6) ? "5" : "6") : ((digit < 8) ? "7" : ((digit < 9) ? "8" : "9"))));
}

/* A component of a texel: its image is a tile of the picture of a view. */
float loden_coefficient(uniform string file; float component, column, row) {
    float down = floor(component / {ACROSS});
    float value = 0;
    if (component < {COMPONENTS}) {
        value = loden_carried(file, (component - {ACROSS} * down) * {TEXELS_WIDE} + column, down * {TEXELS_HIGH} + row,
            {TEXEL_COLUMNS}, {TEXEL_ROWS});
    }
    return value;
}

/* Four components from one on. The name of a texture is the same for all points that are shaded at a time, so that each view has its turn. */
matrix loden_coefficients(uniform string numbers; float of_view, texel, component) {
    float row = floor(texel / {TEXELS_WIDE});
    float column = texel - {TEXELS_WIDE} * row;
    matrix found = loden_four(0, 0, 0, 0);
    uniform float k = 0;
    for (k = 0; k < {VIEWS}; k += 1) {
        uniform string file = concat(numbers, "_view", loden_digit(floor(k / 100)), loden_digit(mod(floor(k / 10), 10)),
            loden_digit(mod(k, 10)), ".tif");
        if (of_view == k) {
            found = loden_four(loden_coefficient(file, component, column, row), loden_coefficient(file, component + 1, column, row),
                loden_coefficient(file, component + 2, column, row), loden_coefficient(file, component + 3, column, row));
        }
    }
    return found;
}

/* The parameter of a view in one of its rows, for a light and channel. */
float loden_parameter(uniform string file; float of_view, row, column) {
    return loden_carried(file, column, of_view * {ROWS_OF_VIEW} + row, {TABLE_COLUMNS}, {TABLE_ROWS});
}

/* The same of a component; beyond the components there is nothing. */
float loden_within(uniform string file; float of_view, component, column) {
    float value = 0;
    if (component < {COMPONENTS}) {
        value = loden_parameter(file, of_view, component, column);
    }
    return value;
}

/* Numbers by the address that they have in one array: the mean, the parameters and the components of texels. */
matrix loden_number(uniform string numbers, indices, directions; float address) {
    uniform string parameters = concat(numbers, "_parameters.tif");
    matrix found = loden_four(0, 0, 0, 0);
    if (address >= {PLANE} && address < {PLANE} + {VIEWS} * {TEXELS} * {GROUPS}) {
        float of_view = floor((address - {PLANE}) / ({TEXELS} * {GROUPS}));
        float rest = address - {PLANE} - of_view * ({TEXELS} * {GROUPS});
        float texel = floor(rest / {GROUPS});
        found = loden_coefficients(numbers, of_view, texel, 4 * (rest - texel * {GROUPS}));
    }
    if (address >= {TABLE} && address < {TABLE} + {VIEWS} * {LIGHTS} * 3 * {GROUPS}) {
        float pair = floor((address - {TABLE}) / (3 * {GROUPS}));
        float rest = address - {TABLE} - pair * (3 * {GROUPS});
        float group = floor(rest / 3);
        float of_view = floor(pair / {LIGHTS});
        float column = 3 * (pair - of_view * {LIGHTS}) + rest - 3 * group;
        float first = 4 * group;
        found = loden_four(loden_within(parameters, of_view, first, column), loden_within(parameters, of_view, first + 1, column),
            loden_within(parameters, of_view, first + 2, column), loden_within(parameters, of_view, first + 3, column));
    }
    if (address >= {MEAN} && address < {MEAN} + {VIEWS} * {LIGHTS}) {
        float of_view = floor((address - {MEAN}) / {LIGHTS});
        float column = 3 * (address - {MEAN} - of_view * {LIGHTS});
        found = loden_four(loden_parameter(parameters, of_view, {COMPONENTS}, column),
            loden_parameter(parameters, of_view, {COMPONENTS}, column + 1),
            loden_parameter(parameters, of_view, {COMPONENTS}, column + 2), 0);
    }
    return found;
}

matrix loden_byte(uniform string numbers, indices, directions; float address) {
    return loden_four(0, 0, 0, 0);
}
