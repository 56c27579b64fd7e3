// A measured material, written by loden. Bind the textures that material.json describes, then call loden_apparent.

// Texels have addresses: along rows, then row by row, then layer by layer.
@group(0) @binding(0) var loden_numbers: texture_2d_array<f32>;
@group(0) @binding(1) var loden_indices: texture_2d_array<f32>;
@group(0) @binding(2) var loden_directions: texture_2d_array<f32>;

fn loden_texel(bank: texture_2d_array<f32>, width: i32, height: i32, address: i32) -> vec4f {
    let row = address / width;
    let layer = row / height;
    return textureLoad(bank, vec2i(address - row * width, row - layer * height), layer, 0);
}

fn loden_number(address: i32) -> vec4f {
    return loden_texel(loden_numbers, {numbers_WIDTH}, {numbers_HEIGHT}, address);
}

fn loden_byte(address: i32) -> vec4f {
    return loden_texel(loden_indices, {indices_WIDTH}, {indices_HEIGHT}, address);
}

fn loden_exact(address: i32) -> vec4f {
    return loden_texel(loden_directions, {directions_WIDTH}, {directions_HEIGHT}, address);
}
