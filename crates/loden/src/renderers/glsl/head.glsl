// A measured material, written by loden. Include this after `#version 300 es` and bind the textures that material.json describes;
// then call loden_apparent.
precision highp float;
precision highp int;
precision highp sampler2DArray;

// Texels have addresses: along rows, then row by row, then layer by layer.
uniform sampler2DArray loden_numbers;
uniform sampler2DArray loden_indices;
uniform sampler2DArray loden_directions;

vec4 loden_texel(sampler2DArray bank, int width, int height, int address) {
    int row = address / width;
    int layer = row / height;
    return texelFetch(bank, ivec3(address - row * width, row - layer * height, layer), 0);
}

vec4 loden_number(int address) {
    return loden_texel(loden_numbers, {numbers_WIDTH}, {numbers_HEIGHT}, address);
}

vec4 loden_byte(int address) {
    return loden_texel(loden_indices, {indices_WIDTH}, {indices_HEIGHT}, address);
}

vec4 loden_exact(int address) {
    return loden_texel(loden_directions, {directions_WIDTH}, {directions_HEIGHT}, address);
}
