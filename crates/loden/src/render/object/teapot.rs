//! The built-in Utah teapot.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Vec2, Vec3};

use super::{BuiltIn, Object};
use crate::Result;
use crate::render::{Camera, Mesh, MeshData, Shape};

pub(super) const TEAPOT: BuiltIn =
    BuiltIn { name: "teapot", doc: "The Utah teapot, from its 32 Bezier patches.", build };

/// Control-point factor that makes a cubic approximate a quarter circle; the teapot has 0.56 instead of 0.5523.
const QUARTER: f32 = 0.56;

/// World units per texture repeat. The belly has radius 2, so the texture repeats four times around it.
const REPEAT: f32 = PI;

/// Segments per side of a patch.
const STEPS: usize = 24;

/// A surface of revolution: a profile of four control points (radius, height), swept by four patches.
struct Revolution {
    profile: [[f32; 2]; 4],
    mapping: Mapping,
}

/// Texture coordinates of a surface of revolution.
#[derive(Clone, Copy)]
enum Mapping {
    /// u around, v along the profile, starting at this arc length.
    Around(f32),
    /// Polar: the distance from the axis is the arc length, starting at this one.
    Polar(f32),
}

/// Newell's data in the version of Crockett, in original units: z up, belly radius 2, height 3.15.
const BODY: [[[f32; 2]; 4]; 3] = [
    [[1.5, 0.15], [1.5, 0.225], [2.0, 0.45], [2.0, 0.9]],
    [[2.0, 0.9], [2.0, 1.35], [1.75, 1.875], [1.5, 2.4]],
    [[1.5, 2.4], [1.4375, 2.531_25], [1.3375, 2.531_25], [1.4, 2.4]],
];
const LID: [[[f32; 2]; 4]; 2] =
    [[[0.0, 3.15], [0.8, 3.15], [0.0, 2.85], [0.2, 2.7]], [[0.2, 2.7], [0.4, 2.55], [1.3, 2.55], [1.3, 2.4]]];
const BOTTOM: [[f32; 2]; 4] = [[0.0, 0.0], [1.425, 0.0], [1.5, 0.075], [1.5, 0.15]];

/// Half a tube: rows along it, each from the plane y = 0 around one side and back to it; (x, y, z).
type Tube = [[[f32; 3]; 4]; 4];

const HANDLE: [Tube; 2] = [
    [
        [[-1.6, 0.0, 2.025], [-1.6, 0.3, 2.025], [-1.5, 0.3, 2.25], [-1.5, 0.0, 2.25]],
        [[-2.3, 0.0, 2.025], [-2.3, 0.3, 2.025], [-2.5, 0.3, 2.25], [-2.5, 0.0, 2.25]],
        [[-2.7, 0.0, 2.025], [-2.7, 0.3, 2.025], [-3.0, 0.3, 2.25], [-3.0, 0.0, 2.25]],
        [[-2.7, 0.0, 1.8], [-2.7, 0.3, 1.8], [-3.0, 0.3, 1.8], [-3.0, 0.0, 1.8]],
    ],
    [
        [[-2.7, 0.0, 1.8], [-2.7, 0.3, 1.8], [-3.0, 0.3, 1.8], [-3.0, 0.0, 1.8]],
        [[-2.7, 0.0, 1.575], [-2.7, 0.3, 1.575], [-3.0, 0.3, 1.35], [-3.0, 0.0, 1.35]],
        [[-2.5, 0.0, 1.125], [-2.5, 0.3, 1.125], [-2.65, 0.3, 0.9375], [-2.65, 0.0, 0.9375]],
        [[-2.0, 0.0, 0.9], [-2.0, 0.3, 0.9], [-1.9, 0.3, 0.6], [-1.9, 0.0, 0.6]],
    ],
];

const SPOUT: [Tube; 2] = [
    [
        [[1.7, 0.0, 1.425], [1.7, 0.66, 1.425], [1.7, 0.66, 0.6], [1.7, 0.0, 0.6]],
        [[2.6, 0.0, 1.425], [2.6, 0.66, 1.425], [3.1, 0.66, 0.825], [3.1, 0.0, 0.825]],
        [[2.3, 0.0, 2.1], [2.3, 0.25, 2.1], [2.4, 0.25, 2.025], [2.4, 0.0, 2.025]],
        [[2.7, 0.0, 2.4], [2.7, 0.25, 2.4], [3.3, 0.25, 2.4], [3.3, 0.0, 2.4]],
    ],
    [
        [[2.7, 0.0, 2.4], [2.7, 0.25, 2.4], [3.3, 0.25, 2.4], [3.3, 0.0, 2.4]],
        [[2.8, 0.0, 2.475], [2.8, 0.25, 2.475], [3.525, 0.25, 2.493_75], [3.525, 0.0, 2.493_75]],
        [[2.9, 0.0, 2.475], [2.9, 0.15, 2.475], [3.45, 0.15, 2.5125], [3.45, 0.0, 2.5125]],
        [[2.8, 0.0, 2.4], [2.8, 0.15, 2.4], [3.2, 0.15, 2.4], [3.2, 0.0, 2.4]],
    ],
];

fn build() -> Result<Object> {
    let mesh = Mesh::new(data())?;
    let shape = Shape::Mesh(mesh.into());
    // The handle is on the left, the spout turned slightly towards the camera.
    let camera = Camera::around(Vec3::new(0.02, -0.1, 0.0), 1.0, 24.0, 24.0, 0.93);
    Ok(Object { camera, ..Object::standing(shape, floor(), Vec::new()) })
}

/// World position of a point in original units: y up, radius about 1.
fn world(p: Vec3) -> Vec3 {
    (Vec3::new(p.x, p.z, -p.y) - Vec3::new(0.2, 1.45, 0.0)) / 3.3
}

fn floor() -> f32 {
    world(Vec3::ZERO).y
}

/// The mesh of all 32 patches, y up.
pub(super) fn data() -> MeshData {
    let mut data = original();
    data.positions.iter_mut().for_each(|p| *p = world(*p));
    data.normals.iter_mut().for_each(|n| *n = Vec3::new(n.x, n.z, -n.y));
    data
}

/// The mesh in original units: z up, on the plane z = 0, the spout towards +x.
pub(in crate::render) fn original() -> MeshData {
    let mut data = MeshData::default();
    let mut length = 0.0;
    for profile in BODY {
        add_revolution(&mut data, &Revolution { profile, mapping: Mapping::Around(length) });
        length += arc_length(profile.map(|[r, z]| Vec3::new(r, 0.0, z)));
    }
    length = 0.0;
    for profile in LID {
        add_revolution(&mut data, &Revolution { profile, mapping: Mapping::Polar(length) });
        length += arc_length(profile.map(|[r, z]| Vec3::new(r, 0.0, z)));
    }
    add_revolution(&mut data, &Revolution { profile: BOTTOM, mapping: Mapping::Polar(0.0) });
    for tubes in [HANDLE, SPOUT] {
        let mut length = 0.0;
        for half in tubes {
            add_tube(&mut data, &half, length);
            length += arc_length(half.map(|row| 0.5 * (Vec3::from(row[0]) + Vec3::from(row[3]))));
        }
    }
    data
}

/// Value and derivative of a cubic Bézier curve.
fn bezier(p: [Vec3; 4], t: f32) -> (Vec3, Vec3) {
    let s = 1.0 - t;
    let value = p[0] * (s * s * s) + p[1] * (3.0 * s * s * t) + p[2] * (3.0 * s * t * t) + p[3] * (t * t * t);
    let slope = (p[1] - p[0]) * (3.0 * s * s) + (p[2] - p[1]) * (6.0 * s * t) + (p[3] - p[2]) * (3.0 * t * t);
    (value, slope)
}

fn arc_length(p: [Vec3; 4]) -> f32 {
    let at = |k: usize| bezier(p, k as f32 / 64.0).0;
    (0..64).map(|k| at(k).distance(at(k + 1))).sum()
}

/// Arc length of a curve up to each of the `STEPS + 1` parameters.
fn arc_lengths(p: [Vec3; 4]) -> Vec<f32> {
    let fine = 16;
    let at = |k: usize| bezier(p, k as f32 / (STEPS * fine) as f32).0;
    let mut lengths = vec![0.0];
    for step in 0..STEPS {
        let length: f32 = (0..fine).map(|k| at(step * fine + k).distance(at(step * fine + k + 1))).sum();
        lengths.push(lengths[step] + length);
    }
    lengths
}

fn add_revolution(data: &mut MeshData, revolution: &Revolution) {
    let profile = revolution.profile.map(|[r, z]| Vec3::new(r, 0.0, z));
    let lengths = arc_lengths(profile);
    let quarter = |r: f32, sector: usize, t: f32| {
        let corner = [Vec2::X, Vec2::new(1.0, QUARTER), Vec2::new(QUARTER, 1.0), Vec2::Y];
        let (p, slope) = bezier(corner.map(|c| (c * r).extend(0.0)), t);
        let rotate = Vec2::from_angle(FRAC_PI_2 * sector as f32);
        (rotate.rotate(p.truncate()), rotate.rotate(slope.truncate()))
    };
    // The outside is on the right of a profile that runs up the body, and on the left of one that runs down the lid.
    let lid = profile[0].z > profile[3].z && profile[0].x < profile[3].x;
    let outwards = if lid { -1.0 } else { 1.0 };
    add_grid(data, STEPS, 4 * STEPS, |i, j| {
        let (p, slope) = bezier(profile, i as f32 / STEPS as f32);
        let (sector, step) = if j == 4 * STEPS { (3, STEPS) } else { (j / STEPS, j % STEPS) };
        let (around, along) = quarter(1.0, sector, step as f32 / STEPS as f32);
        let position = (around * p.x).extend(p.z);
        let radial = (around * slope.x).extend(slope.z);
        let surface_normal = (along.extend(0.0).cross(radial) * outwards).try_normalize();
        let normal = surface_normal.filter(|_| p.x > 1e-6).unwrap_or(Vec3::Z * -outwards);
        let uv = match revolution.mapping {
            Mapping::Around(start) => Vec2::new(4.0 * j as f32 / (4 * STEPS) as f32, (start + lengths[i]) / REPEAT),
            Mapping::Polar(start) => around.normalize() * ((start + lengths[i]) / REPEAT),
        };
        (position, normal, uv)
    });
}

/// A tube: the given half and its mirror image. v runs along the tube, u around it.
fn add_tube(data: &mut MeshData, tube: &Tube, start: f32) {
    let along: Vec<f32> = arc_lengths(tube.map(|row| 0.5 * (Vec3::from(row[0]) + Vec3::from(row[3]))));
    let point = |s: f32, t: f32| {
        let rows = tube.map(|row| bezier(row.map(Vec3::from), t));
        let (p, ds) = bezier(rows.map(|r| r.0), s);
        (p, ds, bezier(rows.map(|r| r.1), s).0)
    };
    let girth: f32 = 2.0 * arc_length(tube[1].map(Vec3::from));
    let (p, ds, dt) = point(0.5, 0.5);
    let outwards = ds.cross(dt).dot(p - 0.5 * (point(0.5, 0.0).0 + point(0.5, 1.0).0)).signum();
    add_grid(data, STEPS, 2 * STEPS, |i, j| {
        let s = i as f32 / STEPS as f32;
        let mirrored = j > STEPS;
        let t = if mirrored { 2 * STEPS - j } else { j } as f32 / STEPS as f32;
        let (mut p, ds, dt) = point(s, t);
        let mut normal = ds.cross(dt).normalize_or_zero() * outwards;
        if mirrored {
            p.y = -p.y;
            normal.y = -normal.y;
        }
        let uv = Vec2::new(girth * j as f32 / (2 * STEPS) as f32, start + along[i]) / REPEAT;
        (p, normal, uv)
    });
}

/// A grid of `rows` by `columns` quadrilaterals; its triangles are oriented along the normals.
fn add_grid(data: &mut MeshData, rows: usize, columns: usize, vertex: impl Fn(usize, usize) -> (Vec3, Vec3, Vec2)) {
    let first = data.positions.len() as u32;
    for (i, j) in (0..=rows).flat_map(|i| (0..=columns).map(move |j| (i, j))) {
        let (position, normal, uv) = vertex(i, j);
        data.positions.push(position);
        data.normals.push(normal);
        data.uvs.push(uv);
    }
    let at = |i: usize, j: usize| first + (i * (columns + 1) + j) as u32;
    for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
        for [a, b, c] in [[at(i, j), at(i, j + 1), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i + 1, j)]] {
            let [p, q, r] = [a, b, c].map(|k| data.positions[k as usize]);
            let normal: Vec3 = [a, b, c].iter().map(|&k| data.normals[k as usize]).sum();
            let area = (q - p).cross(r - p);
            if area.length_squared() > 1e-14 {
                data.triangles.push(if area.dot(normal) < 0.0 { [a, c, b] } else { [a, b, c] });
            }
        }
    }
}
