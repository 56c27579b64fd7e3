//! Implicit surfaces made of blobs.

use glam::{Mat4, Vec3};

use crate::render::MeshData;
use crate::{Error, Result};

/// Field value on the surface: that of a blob at half its radius.
const LEVEL: f32 = 27.0 / 64.0;

/// Number of cells along the longest side of the box around all blobs.
const CELLS: usize = 64;

/// Maximum number of blob evaluations; beyond it the grid becomes coarser.
const MAX_EVALUATIONS: f64 = 3e8;

/// Maximum number of instructions of a field.
const MAX_INSTRUCTIONS: usize = 1 << 16;

/// An instruction of a field. Operands are the indices of earlier instructions.
#[derive(Debug, Clone, PartialEq)]
pub enum Instruction {
    /// A constant.
    Constant(f32),
    /// A blob of radius 1 around the origin, transformed by a matrix.
    Ellipsoid {
        /// Transform from the object to the blob.
        blob_from_object: Mat4,
        /// Transform from the blob to the object.
        object_from_blob: Mat4,
    },
    /// A blob around a segment.
    Segment {
        /// End points.
        ends: [Vec3; 2],
        /// Distance at which the value is 0.
        radius: f32,
        /// Transform from the object to the segment.
        blob_from_object: Mat4,
        /// Transform from the segment to the object.
        object_from_blob: Mat4,
    },
    /// A sum.
    Add(Vec<usize>),
    /// A product.
    Multiply(Vec<usize>),
    /// The maximum.
    Max(Vec<usize>),
    /// The minimum.
    Min(Vec<usize>),
    /// The first operand divided by the second.
    Divide([usize; 2]),
    /// The first operand minus the second.
    Subtract([usize; 2]),
    /// The negated operand.
    Negate(usize),
    /// The operand itself.
    Same(usize),
}

/// The value of a blob at a squared distance relative to its radius: 1 in the centre, 0 outside the radius.
fn blob(r2: f32) -> f32 {
    if r2 >= 1.0 { 0.0 } else { (1.0 - r2).powi(3) }
}

impl Instruction {
    /// The box outside of which a blob is 0; `None` for other instructions.
    fn extent(&self) -> Option<[Vec3; 2]> {
        let around = |matrix: &Mat4, boxes: [Vec3; 2]| {
            let corner = |k: usize| Vec3::from_array(std::array::from_fn(|axis| boxes[k >> axis & 1][axis]));
            let corners = (0..8).map(|k| matrix.transform_point3(corner(k)));
            corners.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
        };
        match self {
            Self::Ellipsoid { object_from_blob, .. } => Some(around(object_from_blob, [Vec3::NEG_ONE, Vec3::ONE])),
            Self::Segment { ends: [a, b], radius, object_from_blob, .. } => {
                Some(around(object_from_blob, [a.min(*b) - *radius, a.max(*b) + *radius]))
            }
            _ => None,
        }
    }

    fn value(&self, p: Vec3, earlier: &[f32]) -> f32 {
        let of = |list: &[usize]| list.iter().map(|&i| earlier[i]).collect::<Vec<f32>>();
        match self {
            Self::Constant(value) => *value,
            Self::Ellipsoid { blob_from_object, .. } => blob(blob_from_object.transform_point3(p).length_squared()),
            Self::Segment { ends: [a, b], radius, blob_from_object, .. } => {
                let p = blob_from_object.transform_point3(p);
                let along = ((p - *a).dot(*b - *a) / (*b - *a).length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
                blob(p.distance_squared(a.lerp(*b, along)) / (radius * radius))
            }
            Self::Add(list) => list.iter().map(|&i| earlier[i]).sum(),
            Self::Multiply(list) => list.iter().map(|&i| earlier[i]).product(),
            Self::Max(list) => of(list).into_iter().fold(f32::NEG_INFINITY, f32::max),
            Self::Min(list) => of(list).into_iter().fold(f32::INFINITY, f32::min),
            Self::Divide([a, b]) => earlier[*a] / earlier[*b],
            Self::Subtract([a, b]) => earlier[*a] - earlier[*b],
            Self::Negate(a) => -earlier[*a],
            Self::Same(a) => earlier[*a],
        }
    }

    fn operands(&self) -> Vec<usize> {
        match self {
            Self::Add(list) | Self::Multiply(list) | Self::Max(list) | Self::Min(list) => list.clone(),
            Self::Divide(both) | Self::Subtract(both) => both.to_vec(),
            Self::Negate(one) | Self::Same(one) => vec![*one],
            _ => Vec::new(),
        }
    }
}

/// Triangulates the surface where the last instruction has the value of a blob at half its radius. Normals follow the
/// gradient.
///
/// # Model
/// At the distance r, relative to its radius, a blob has the value (1 - r^2)^3. The field is evaluated at the nodes
/// of a grid. Each cell is divided into six tetrahedra, whose edges cross the surface where linear interpolation is
/// zero.
///
/// # Limits
/// Parts thinner than a cell are lost.
///
/// # References
/// pixar2000 (RiBlobby); doi1991 for tetrahedra
///
/// # Errors
/// [`Error::Parameter`] if an operand does not exist, or the field has no blobs or no surface.
pub fn implicit_mesh(instructions: &[Instruction]) -> Result<MeshData> {
    let bad = |problem: &str| Err(Error::parameter("blobs", problem));
    if instructions.len() > MAX_INSTRUCTIONS {
        return bad("found more than 65536 instructions");
    }
    if instructions.iter().enumerate().any(|(k, one)| one.operands().iter().any(|&operand| operand >= k)) {
        return bad("found an operand that is not an earlier instruction");
    }
    let boxes: Vec<Option<[Vec3; 2]>> = instructions.iter().map(Instruction::extent).collect();
    let all = boxes.iter().flatten().copied().reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
    let Some([low, high]) = all.filter(|[low, high]| low.is_finite() && high.is_finite() && low.cmplt(*high).all())
    else {
        return bad("found no blob of finite size");
    };
    let field = Field { instructions, boxes: &boxes };
    let grid = Grid::around(low, high, instructions.len());
    let mut values = Vec::with_capacity(grid.nodes());
    let mut scratch = Vec::with_capacity(instructions.len());
    for k in 0..grid.nodes() {
        values.push(field.value(grid.place(k), &mut scratch) - LEVEL);
    }
    let mut data = grid.surface(&values);
    if data.triangles.is_empty() {
        return bad("the field has no surface");
    }
    let step = 0.2 * grid.cell;
    for &p in &data.positions {
        let mut slope =
            |axis: Vec3| field.value(p + axis * step, &mut scratch) - field.value(p - axis * step, &mut scratch);
        let gradient = Vec3::new(slope(Vec3::X), slope(Vec3::Y), slope(Vec3::Z));
        data.normals.push((-gradient).normalize_or(Vec3::Z));
    }
    Ok(data)
}

struct Field<'a> {
    instructions: &'a [Instruction],
    boxes: &'a [Option<[Vec3; 2]>],
}

impl Field<'_> {
    fn value(&self, p: Vec3, scratch: &mut Vec<f32>) -> f32 {
        scratch.clear();
        for (instruction, extent) in self.instructions.iter().zip(self.boxes) {
            let outside = extent.is_some_and(|[low, high]| p.cmplt(low).any() || p.cmpgt(high).any());
            let value = if outside { 0.0 } else { instruction.value(p, scratch) };
            // quotients can have any value
            scratch.push(if value.is_nan() { 0.0 } else { value.clamp(-1e6, 1e6) });
        }
        scratch.last().copied().unwrap_or(0.0)
    }
}

struct Grid {
    low: Vec3,
    cell: f32,
    /// Nodes along each axis.
    size: [usize; 3],
}

impl Grid {
    fn around(low: Vec3, high: Vec3, instructions: usize) -> Self {
        let extent = high - low;
        let mut cells = CELLS as f32;
        loop {
            let cell = extent.max_element() / cells;
            let size = (extent / cell).to_array().map(|n| n.ceil() as usize + 3);
            let evaluations = size.iter().product::<usize>() as f64 * instructions as f64;
            if evaluations <= MAX_EVALUATIONS || cells < 8.0 {
                return Self { low: low - cell, cell, size };
            }
            cells *= 0.9;
        }
    }

    fn nodes(&self) -> usize {
        self.size.iter().product()
    }

    fn place(&self, node: usize) -> Vec3 {
        let [nx, ny, _] = self.size;
        self.low + self.cell * Vec3::new((node % nx) as f32, (node / nx % ny) as f32, (node / (nx * ny)) as f32)
    }

    /// Triangles between positive and negative nodes, counter-clockwise seen from the negative side.
    fn surface(&self, values: &[f32]) -> MeshData {
        /// Tetrahedra around the diagonal of a cell, as corner numbers whose bits are x, y, z.
        const TETRAHEDRA: [[usize; 4]; 6] =
            [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];
        let [nx, ny, nz] = self.size;
        let mut data = MeshData::default();
        let mut known = std::collections::HashMap::new();
        for (x, y, z) in (0..nz - 1).flat_map(|z| (0..ny - 1).flat_map(move |y| (0..nx - 1).map(move |x| (x, y, z)))) {
            let node = |corner: usize| (x + (corner & 1)) + nx * ((y + (corner >> 1 & 1)) + ny * (z + (corner >> 2)));
            let nodes: [usize; 8] = std::array::from_fn(node);
            let inside = nodes.iter().filter(|&&n| values[n] > 0.0).count();
            if inside == 0 || inside == 8 {
                continue;
            }
            for tetrahedron in TETRAHEDRA {
                let corners = tetrahedron.map(|corner| nodes[corner]);
                self.cut(corners, values, &mut known, &mut data);
            }
        }
        data
    }

    fn cut(
        &self,
        corners: [usize; 4],
        values: &[f32],
        known: &mut std::collections::HashMap<[usize; 2], u32>,
        data: &mut MeshData,
    ) {
        let (inside, outside): (Vec<usize>, Vec<usize>) = corners.iter().partition(|&&node| values[node] > 0.0);
        let mut crossing = |a: usize, b: usize| {
            *known.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                let t = values[a] / (values[a] - values[b]);
                data.positions.push(self.place(a).lerp(self.place(b), t.clamp(0.0, 1.0)));
                data.positions.len() as u32 - 1
            })
        };
        let mut polygon: Vec<u32> = match (&inside[..], &outside[..]) {
            ([a], others) | (others, [a]) => others.iter().map(|&b| crossing(*a, b)).collect(),
            ([a, b], [c, d]) => vec![crossing(*a, *c), crossing(*a, *d), crossing(*b, *d), crossing(*b, *c)],
            _ => return,
        };
        // Orient the triangle counter-clockwise seen from outside
        let mean = |nodes: &[usize]| nodes.iter().map(|&n| self.place(n)).sum::<Vec3>() / nodes.len() as f32;
        let corner = |k: usize| data.positions[polygon[k] as usize];
        let area: Vec3 = (2..polygon.len()).map(|k| (corner(k - 1) - corner(0)).cross(corner(k) - corner(0))).sum();
        if area.dot(mean(&outside) - mean(&inside)) < 0.0 {
            polygon.reverse();
        }
        for k in 2..polygon.len() {
            let triangle = [polygon[0], polygon[k - 1], polygon[k]];
            let [a, b, c] = triangle.map(|i| data.positions[i as usize]);
            if (b - a).cross(c - a) != Vec3::ZERO {
                data.triangles.push(triangle);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball(centre: Vec3, radius: f32) -> Instruction {
        let object_from_blob = Mat4::from_translation(centre) * Mat4::from_scale(Vec3::splat(radius));
        Instruction::Ellipsoid { blob_from_object: object_from_blob.inverse(), object_from_blob }
    }

    #[test]
    fn a_blob_is_a_ball_of_half_its_radius() {
        let data = implicit_mesh(&[ball(Vec3::X, 2.0)]).unwrap();
        for (p, n) in data.positions.iter().zip(&data.normals) {
            let out = *p - Vec3::X;
            assert!((out.length() - 1.0).abs() < 2e-3 && n.dot(out) > 0.99, "{p} {n}");
        }
        for t in &data.triangles {
            let [a, b, c] = t.map(|i| data.positions[i as usize] - Vec3::X);
            // Slivers have no orientation: coordinates are accurate to about 1e-7, edges are up to 0.1 long.
            let area = (b - a).cross(c - a);
            assert!(area.length() < 1e-7 || area.dot(a + b + c) > 0.0, "{a} {b} {c}");
        }
        let edges: usize = 3 * data.triangles.len() / 2;
        // Tiny triangles must not be dropped for their area: the surface is closed.
        assert!(data.positions.len() + data.triangles.len() >= edges);
    }

    #[test]
    fn blobs_flow_together_and_are_cut() {
        let pair = [ball(Vec3::ZERO, 1.0), ball(Vec3::X * 1.1, 1.0), Instruction::Add(vec![0, 1])];
        let neck = |data: &MeshData| data.positions.iter().any(|p| (p.x - 0.55).abs() < 0.02);
        assert!(neck(&implicit_mesh(&pair).unwrap()));
        let apart = [pair[0].clone(), pair[1].clone(), Instruction::Max(vec![0, 1])];
        assert!(!neck(&implicit_mesh(&apart).unwrap()));
        let segment = Instruction::Segment {
            ends: [Vec3::ZERO, Vec3::X],
            radius: 0.4,
            blob_from_object: Mat4::IDENTITY,
            object_from_blob: Mat4::IDENTITY,
        };
        assert!(neck(&implicit_mesh(&[segment]).unwrap()));
    }

    #[test]
    fn wrong_fields_are_errors() {
        for wrong in [vec![], vec![Instruction::Constant(1.0)], vec![ball(Vec3::ZERO, 1.0), Instruction::Add(vec![1])]]
        {
            assert!(implicit_mesh(&wrong).is_err(), "{wrong:?}");
        }
        assert!(implicit_mesh(&[ball(Vec3::ZERO, 1.0), Instruction::Negate(0)]).is_err(), "no surface");
    }
}
