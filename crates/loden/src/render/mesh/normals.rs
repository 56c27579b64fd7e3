//! Vertex normals by a crease angle.

use glam::Vec3;

use super::MeshData;
use crate::render::bounds::Ball;

/// Around a vertex with more triangles than this, each triangle keeps its own normal: the time grows with the square.
const MOST_AROUND: usize = 64;

/// Computes the normals that a mesh lacks: those that are zero or not finite, or all if the list is empty. A corner's
/// normal is the mean over the triangles around its vertex, weighted by area, whose planes are within the crease angle of
/// its own triangle's; they are turned to the same side first, so windings may differ. A vertex whose corners get
/// different normals is split.
pub(super) fn complete(data: &mut MeshData, crease_degrees: f32) {
    let count = data.positions.len();
    data.normals.resize(count, Vec3::ZERO);
    let missing: Vec<usize> = (0..count).filter(|&vertex| data.normals[vertex].try_normalize().is_none()).collect();
    if missing.is_empty() {
        return;
    }
    let areas = area_vectors(data);
    let facing: Vec<Vec3> = areas.iter().map(|area| area.normalize_or_zero()).collect();
    let (first, corners) = corners_around(data);
    // with room for rounding, so that a triangle is within any angle of itself
    let cosine = crease_degrees.to_radians().cos() - 1e-6;
    let mut made: Vec<(Vec3, u32)> = Vec::new();
    for vertex in missing {
        let around = &corners[first[vertex]..first[vertex + 1]];
        data.normals[vertex] = Vec3::Y;
        made.clear();
        for &corner in around {
            let (triangle, own) = (corner / 3, facing[corner / 3]);
            let turned = |other: &usize| {
                let along = own.dot(facing[other / 3]);
                if along.abs() >= cosine { areas[other / 3] * along.signum() } else { Vec3::ZERO }
            };
            let smooth = || around.iter().map(turned).sum::<Vec3>().normalize_or(own);
            let normal = if around.len() > MOST_AROUND { own } else { smooth() };
            let recent = &made[made.len().saturating_sub(MOST_AROUND)..];
            let known = recent.iter().find(|(other, _)| *other == normal).map(|(_, index)| *index);
            let index = known.unwrap_or_else(|| {
                let index = if made.is_empty() { vertex } else { copy_vertex(data, vertex) };
                data.normals[index] = normal;
                made.push((normal, index as u32));
                index as u32
            });
            data.triangles[triangle][corner % 3] = index;
        }
    }
}

/// Twice the area vectors of the triangles, in units of the mesh (a power of two, so that nothing is rounded): those of
/// a tiny mesh would be too small for single precision.
fn area_vectors(data: &MeshData) -> Vec<Vec3> {
    let radius = Ball::around(&data.positions).radius.clamp(f32::MIN_POSITIVE, 1e15);
    let unit = f32::from_bits(radius.to_bits() & 0x7f80_0000).recip();
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| data.positions[i as usize]);
        ((b - a) * unit).cross((c - a) * unit)
    };
    data.triangles.iter().map(of).collect()
}

/// The corners of all triangles, counted through, sorted by vertex, and the first one of each vertex.
fn corners_around(data: &MeshData) -> (Vec<usize>, Vec<usize>) {
    let mut first = vec![0; data.positions.len() + 1];
    data.triangles.as_flattened().iter().for_each(|&i| first[i as usize + 1] += 1);
    (1..first.len()).for_each(|k| first[k] += first[k - 1]);
    let mut next = first.clone();
    let mut corners = vec![0; 3 * data.triangles.len()];
    for (corner, &vertex) in data.triangles.as_flattened().iter().enumerate() {
        corners[next[vertex as usize]] = corner;
        next[vertex as usize] += 1;
    }
    (first, corners)
}

/// Appends a copy of a vertex and returns its index.
fn copy_vertex(data: &mut MeshData, vertex: usize) -> usize {
    data.positions.push(data.positions[vertex]);
    data.normals.push(Vec3::Y);
    if let Some(&uv) = data.uvs.get(vertex) {
        data.uvs.push(uv);
    }
    if let Some(&tangent) = data.tangents.get(vertex) {
        data.tangents.push(tangent);
    }
    data.positions.len() - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube of two triangles per side with shared corners; every second triangle is reversed if `mixed`.
    fn cube(mixed: bool) -> MeshData {
        let positions = (0..8).map(|k| Vec3::new((k & 1) as f32, (k >> 1 & 1) as f32, (k >> 2) as f32)).collect();
        let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let mut triangles: Vec<[u32; 3]> = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        triangles.iter_mut().step_by(2).filter(|_| mixed).for_each(|t| t.swap(1, 2));
        MeshData { positions, triangles, ..MeshData::default() }
    }

    fn normals(data: &MeshData) -> impl Iterator<Item = (Vec3, [Vec3; 3])> {
        let facing = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| data.positions[i as usize]);
            (b - a).cross(c - a).normalize()
        };
        data.triangles.iter().map(move |t| (facing(t), t.map(|i| data.normals[i as usize])))
    }

    #[test]
    fn cubes_are_flat_unless_the_angle_says_otherwise() {
        for mixed in [false, true] {
            let mut data = cube(mixed);
            complete(&mut data, 40.0);
            assert!(normals(&data).all(|(own, corners)| corners.iter().all(|n| n.dot(own) > 0.999)));
            assert_eq!(data.positions.len(), if mixed { 36 } else { 24 });
        }
        let mut data = cube(false);
        complete(&mut data, 120.0);
        assert_eq!(data.positions.len(), 8);
        assert!(data.normals.iter().zip(&data.positions).all(|(n, p)| n.dot(*p - 0.5) > 0.8));
    }

    #[test]
    fn faces_in_both_windings_do_not_cancel() {
        let square = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
        let triangles = vec![[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]];
        let mut data = MeshData { positions: square, triangles, ..MeshData::default() };
        complete(&mut data, 40.0);
        assert!(normals(&data).all(|(own, corners)| corners.iter().all(|n| n.dot(own) > 0.999)));
    }

    #[test]
    fn gentle_bends_are_smooth_and_shared() {
        let n = 36;
        let angle = |k: usize| (k % n) as f32 * std::f32::consts::TAU / n as f32;
        let at = |k: usize, z: f32| Vec3::new(angle(k).cos(), angle(k).sin(), z) * 1e-8;
        let positions = (0..2 * n).map(|k| at(k / 2, (k % 2) as f32)).collect();
        let side = |k: usize| [2 * k, (2 * k + 2) % (2 * n), (2 * k + 3) % (2 * n), 2 * k + 1].map(|i| i as u32);
        let triangles = (0..n).map(side).flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let mut data = MeshData { positions, triangles, ..MeshData::default() };
        complete(&mut data, 40.0);
        assert_eq!(data.positions.len(), 2 * n);
        let radial = |p: &Vec3| p.with_z(0.0).normalize();
        assert!(data.normals.iter().zip(&data.positions).all(|(n, p)| n.dot(radial(p)) > 0.99));
    }

    #[test]
    fn one_bad_normal_does_not_spoil_the_others() {
        let mut data = cube(false);
        data.normals = data.positions.iter().map(|p| (*p - 0.5) * 0.1).collect();
        data.normals[3] = Vec3::ZERO;
        data.normals[5] = Vec3::splat(f32::NAN);
        let before = data.normals.clone();
        complete(&mut data, 180.0);
        assert!((0..8).filter(|k| ![3, 5].contains(k)).all(|k| data.normals[k] == before[k]));
        assert!([3, 5].iter().all(|&k| data.normals[k].dot(data.positions[k] - 0.5) > 0.7));
    }
}
