//! Colours that vary over a shape, as pictures that texture coordinates refer to.
//!
//! # Model
//! Each triangle has 2 x 2 texels of its own: its corners lie in the centres of three of them, and the fourth continues
//! the plane through their colours. Bilinear interpolation between them is then linear over the triangle, and bilinear
//! over a quadrilateral that uses all four.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::meshes::Corners;
use crate::picture::Picture;
use crate::render::MeshData;

/// Maximum number of blocks of 2 x 2 texels; shapes with more colours have their mean.
const MAX_BLOCKS: usize = 1 << 21;

/// Positions of the corners 0, 1, 2 and 3 in a block.
const PLACES: [[usize; 2]; 4] = [[0, 0], [1, 0], [0, 1], [1, 1]];

/// Blocks of four colours, each different block once.
#[derive(Default)]
struct Blocks {
    colors: Vec<[Vec3; 4]>,
    known: HashMap<[[u32; 3]; 4], usize>,
}

impl Blocks {
    fn add(&mut self, colors: [Vec3; 4]) -> usize {
        let key = colors.map(|c| c.to_array().map(f32::to_bits));
        *self.known.entry(key).or_insert_with(|| {
            self.colors.push(colors);
            self.colors.len() - 1
        })
    }

    fn columns(&self) -> usize {
        (self.colors.len() as f64).sqrt().ceil().max(1.0) as usize
    }

    /// The texture coordinate of a corner of a block; v points up.
    fn uv(&self, block: usize, corner: usize) -> Vec2 {
        let columns = self.columns();
        let rows = self.colors.len().div_ceil(columns);
        let [x, y] = [2 * (block % columns) + PLACES[corner][0], 2 * (block / columns) + PLACES[corner][1]];
        Vec2::new((x as f32 + 0.5) / (2 * columns) as f32, 1.0 - (y as f32 + 0.5) / (2 * rows) as f32)
    }

    fn picture(&self) -> Picture {
        let columns = self.columns();
        let rows = self.colors.len().div_ceil(columns);
        let mut picture = Picture::filled(2 * columns, 2 * rows, Vec3::ZERO);
        for (block, colors) in self.colors.iter().enumerate() {
            for (color, [x, y]) in colors.iter().zip(PLACES) {
                picture.rgb[(2 * (block / columns) + y) * 2 * columns + 2 * (block % columns) + x] = *color;
            }
        }
        picture
    }
}

/// Paints a mesh with a colour for each vertex: replaces its texture coordinates, and its vertices by three of each
/// triangle. `None` if it has too many colours.
pub(super) fn mesh(data: &mut MeshData, colors: &[Vec3]) -> Option<Arc<Picture>> {
    let mut blocks = Blocks::default();
    let of_triangle: Vec<usize> = data
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| colors[i as usize]);
            blocks.add([a, b, c, b + c - a])
        })
        .collect();
    if blocks.colors.len() > MAX_BLOCKS {
        return None;
    }
    let source = std::mem::take(data);
    for (t, block) in source.triangles.iter().zip(of_triangle) {
        let first = data.positions.len() as u32;
        for (corner, &i) in t.iter().enumerate() {
            let i = i as usize;
            data.positions.push(source.positions[i]);
            data.normals.extend(source.normals.get(i));
            data.uvs.push(blocks.uv(block, corner));
        }
        data.triangles.push([first, first + 1, first + 2]);
    }
    Some(Arc::new(blocks.picture()))
}

/// Paints polygons with a colour for each corner, all corners in a row, `counts` per polygon. Returns the texture
/// coordinates of the corners and the picture; polygons of more than four corners have their mean colour.
pub(super) fn faces(counts: &[usize], colors: &[Vec3]) -> Option<(Vec<Vec2>, Arc<Picture>)> {
    let mut blocks = Blocks::default();
    let mut rest = colors;
    let mut of_face = Vec::with_capacity(counts.len());
    for &count in counts {
        let (own, others) = rest.split_at_checked(count)?;
        rest = others;
        let mean = own.iter().sum::<Vec3>() / count.max(1) as f32;
        of_face.push(blocks.add(match *own {
            [a, b, c] => [a, b, c, b + c - a],
            // corners of a face run around it
            [a, b, c, d] => [a, b, d, c],
            _ => [mean; 4],
        }));
    }
    if blocks.colors.len() > MAX_BLOCKS {
        return None;
    }
    let uvs = counts.iter().zip(&of_face).flat_map(|(&count, &block)| {
        let blocks = &blocks;
        (0..count).map(move |corner| match count {
            3 => blocks.uv(block, corner),
            4 => blocks.uv(block, [0, 1, 3, 2][corner]),
            _ => blocks.uv(block, 0),
        })
    });
    Some((uvs.collect(), Arc::new(blocks.picture())))
}

/// Paints a parametric surface with a grid of colours, u fastest. Returns the texture coordinates of its corners, t
/// downwards, and the picture.
pub(super) fn grid([columns, rows]: [usize; 2], colors: &[Vec3]) -> Option<(Corners, Arc<Picture>)> {
    if colors.len() != columns * rows || colors.is_empty() {
        return None;
    }
    let edge = 0.5 / Vec2::new(columns as f32, rows as f32);
    let (low, high) = (edge, 1.0 - edge);
    let corners = [low, Vec2::new(high.x, low.y), Vec2::new(low.x, high.y), high];
    Some((corners, Arc::new(Picture { width: columns, height: rows, rgb: colors.to_vec() })))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_triangles_share_texels() {
        let mut data = MeshData {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE],
            triangles: vec![[0, 1, 2], [1, 3, 2], [0, 1, 3]],
            ..MeshData::default()
        };
        let picture = mesh(&mut data, &[Vec3::X; 4]).unwrap();
        assert_eq!((picture.width, picture.height, data.positions.len()), (2, 2, 9));
    }

    #[test]
    fn corners_have_their_colors() {
        let colors: Vec<Vec3> = (0..11).map(|k| Vec3::splat(k as f32)).collect();
        let (uvs, picture) = faces(&[3, 4, 4], &colors).unwrap();
        for (uv, color) in uvs.iter().zip(&colors) {
            let (x, y) = (uv.x * picture.width as f32, (1.0 - uv.y) * picture.height as f32);
            assert_eq!(picture.at(x as usize, y as usize), *color, "{uv}");
        }
        assert!(faces(&[12], &colors).is_none());
    }
}
