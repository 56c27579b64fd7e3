//! Curves as ribbons and points as discs; both face the camera, as in RenderMan.

use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};

use super::request::{Class, Parameters, Request, RibResult};
use crate::render::MeshData;
use crate::render::geometry::Basis;

/// Segments of a ribbon for each piece of a cubic curve.
const STEPS: usize = 6;

/// Maximum number of triangles of a request.
const MAX_TRIANGLES: usize = 1 << 23;

/// A mesh, and for each vertex the index of the control point and of the curve it belongs to.
pub(super) struct Strands {
    pub data: MeshData,
    pub points: Vec<[usize; 2]>,
}

/// Towards the camera from a point; `viewer` is the camera's position, or a direction with w = 0.
fn towards(viewer: Vec4, p: Vec3) -> Vec3 {
    (viewer.xyz() - p * viewer.w).normalize_or(Vec3::Z)
}

/// The discs of `Points`.
pub(super) fn points(parameters: &Parameters, viewer: Vec4) -> RibResult<Strands> {
    let centres = parameters.points()?;
    if centres.len() > MAX_TRIANGLES / 4 {
        return Err(format!("found {} points, more than {}", centres.len(), MAX_TRIANGLES / 4));
    }
    let mut strands = Strands { data: MeshData::default(), points: Vec::new() };
    let data = &mut strands.data;
    for (k, &centre) in centres.iter().enumerate() {
        let normal = towards(viewer, centre);
        let x = normal.any_orthonormal_vector();
        let y = normal.cross(x);
        let radius = 0.5 * width(parameters, k, k).abs();
        let first = data.positions.len() as u32;
        for corner in 0..6 {
            let (sin, cos) = (corner as f32 * std::f32::consts::FRAC_PI_3).sin_cos();
            data.positions.push(centre + (x * cos + y * sin) * radius);
            data.normals.push(normal);
            data.uvs.push(Vec2::new(0.5 + 0.5 * cos, 0.5 + 0.5 * sin));
            strands.points.push([k, 0]);
        }
        if radius > 0.0 {
            data.triangles.extend((1..5).map(|i| [first, first + i, first + i + 1]));
        }
    }
    Ok(strands)
}

/// The width at a point or along a curve.
fn width(parameters: &Parameters, point: usize, varying: usize) -> f32 {
    let constant = parameters.number("constantwidth", 1.0);
    let Some(p) = parameters.get("width") else { return constant };
    let at = match p.class {
        Class::Vertex => point,
        Class::Varying | Class::FaceVarying => varying,
        Class::Uniform | Class::Constant => 0,
    };
    // a list that is too short repeats its last value
    p.numbers.get(at).or(p.numbers.last()).copied().unwrap_or(constant)
}

/// The ribbons of `Curves`.
pub(super) fn curves(request: &Request, parameters: &Parameters, basis: &Basis, viewer: Vec4) -> RibResult<Strands> {
    let cubic = match request.text(0)? {
        "cubic" => true,
        "linear" => false,
        other => return Err(format!("found {other:?}, expected linear or cubic")),
    };
    let periodic = request.text(2)? == "periodic";
    let positions = parameters.points()?;
    let counts = request.integers(1)?;
    let total: usize = counts.iter().map(|&n| n as usize).sum();
    if total > positions.len() {
        return Err(format!("found {} points, expected {total}", positions.len()));
    }
    if total * STEPS * 2 > MAX_TRIANGLES {
        return Err(format!("found {total} points, more than {}", MAX_TRIANGLES / STEPS / 2));
    }
    let mut strands = Strands { data: MeshData::default(), points: Vec::new() };
    let (mut first, mut first_varying) = (0, 0);
    for (curve, &count) in counts.iter().enumerate() {
        let count = count as usize;
        let own = &positions[first..first + count];
        let line = if cubic { cubic_line(own, basis, periodic) } else { straight_line(own, periodic) };
        let pieces = line.iter().map(|place| place.varying as usize).max().unwrap_or(0);
        ribbon(&mut strands, &line, viewer, |place| {
            let at = first + place.point;
            let next = place.varying.floor() as usize + 1;
            let [a, b] = [place.varying.floor() as usize, next.min(pieces.max(1))]
                .map(|k| width(parameters, at, first_varying + k));
            (a + (b - a) * place.varying.fract(), [at, curve])
        });
        first += count;
        first_varying += pieces + 1;
    }
    Ok(strands)
}

/// A point of a curve.
struct Place {
    position: Vec3,
    tangent: Vec3,
    /// The nearest control point of the curve.
    point: usize,
    /// The parameter of varying values: whole numbers at the ends of pieces.
    varying: f32,
}

fn straight_line(points: &[Vec3], periodic: bool) -> Vec<Place> {
    let count = points.len();
    let last = if periodic { count } else { count.saturating_sub(1) };
    (0..=last)
        .filter(|_| count > 1)
        .map(|k| {
            let at = |i: usize| points[if periodic { i % count } else { i.min(count - 1) }];
            let before = if k > 0 { at(k - 1) } else { at(0) };
            let tangent = (at(k + 1) - at(k)).normalize_or_zero() + (at(k) - before).normalize_or_zero();
            Place { position: at(k), tangent, point: k % count, varying: k as f32 }
        })
        .collect()
}

fn cubic_line(points: &[Vec3], basis: &Basis, periodic: bool) -> Vec<Place> {
    let (count, step) = (points.len(), basis.step.max(1));
    let pieces = match periodic {
        true => count / step,
        false if count < 4 => 0,
        false => (count - 4) / step + 1,
    };
    let mut line = Vec::new();
    for piece in 0..pieces {
        let control: [Vec3; 4] = std::array::from_fn(|k| points[(piece * step + k) % count]);
        let from = usize::from(piece > 0);
        for k in from..=STEPS {
            let t = k as f32 / STEPS as f32;
            let [position, tangent] = basis.weights(t).map(|w| (0..4).map(|i| control[i] * w[i]).sum::<Vec3>());
            let point = (piece * step + (t * 3.0).round() as usize) % count;
            line.push(Place { position, tangent, point, varying: piece as f32 + t });
        }
    }
    line
}

fn ribbon(strands: &mut Strands, line: &[Place], viewer: Vec4, of: impl Fn(&Place) -> (f32, [usize; 2])) {
    let data = &mut strands.data;
    let first = data.positions.len() as u32;
    for (k, place) in line.iter().enumerate() {
        let normal = towards(viewer, place.position);
        let (width, point) = of(place);
        let across = normal.cross(place.tangent).normalize_or(normal.any_orthonormal_vector()) * (0.5 * width);
        let v = k as f32 / (line.len() - 1).max(1) as f32;
        for (side, u) in [(-1.0, 0.0), (1.0, 1.0)] {
            data.positions.push(place.position + across * side);
            data.normals.push(normal);
            data.uvs.push(Vec2::new(u, v));
            strands.points.push(point);
        }
    }
    for k in 1..line.len() as u32 {
        let [a, b] = [first + 2 * k - 2, first + 2 * k];
        for triangle in [[a, a + 1, b + 1], [a, b + 1, b]] {
            let [p, q, r] = triangle.map(|i| data.positions[i as usize]);
            if (q - p).cross(r - p) != Vec3::ZERO {
                data.triangles.push(triangle);
            }
        }
    }
}
