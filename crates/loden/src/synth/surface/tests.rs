//! What a surface keeps of a sample.

use std::f64::consts::TAU;

use super::*;
use crate::progress::Silent;
use crate::random::{mix, unit};

/// A grid of points that closes around one or both directions.
fn grid(columns: usize, rows: usize, closes: [bool; 2], at: impl Fn(f64, f64) -> DVec3) -> Vec<[DVec3; 3]> {
    let point = |i: usize, j: usize| {
        let (i, j) = (if closes[0] { i % columns } else { i }, if closes[1] { j % rows } else { j });
        at(i as f64 / columns as f64, j as f64 / rows as f64)
    };
    (0..columns * rows)
        .map(|k| (k % columns, k / columns))
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

fn sphere() -> Vec<[DVec3; 3]> {
    grid(24, 12, [true, false], |u, v| {
        let (phi, theta) = (u * TAU, v * TAU / 2.0);
        // the poles are the same point for every column
        let s = if v == 0.0 || v == 1.0 { 0.0 } else { theta.sin() };
        DVec3::new(s * phi.cos(), s * phi.sin(), -theta.cos())
    })
}

fn torus() -> Vec<[DVec3; 3]> {
    grid(30, 16, [true, true], |u, v| {
        let (a, b) = (u * TAU, v * TAU);
        DVec3::new((3.0 + b.cos()) * a.cos(), (3.0 + b.cos()) * a.sin(), b.sin())
    })
}

fn plane(cells: usize) -> Vec<[DVec3; 3]> {
    grid(cells, cells, [false, false], |u, v| DVec3::new(u, v, 0.0))
}

fn mesh(corners: &[[DVec3; 3]]) -> Mesh {
    Mesh::new(corners, &|_| {}).unwrap()
}

impl Mesh {
    /// Vertices minus edges plus triangles.
    fn euler_characteristic(&self) -> i64 {
        let sides = |across: &[Option<(usize, usize)>; 3]| -> usize {
            across.iter().map(|a| 1 + usize::from(a.is_none())).sum()
        };
        let edges: usize = self.across.iter().map(sides).sum::<usize>() / 2;
        let mut used = vec![false; self.positions.len()];
        self.triangles.iter().flatten().for_each(|corner| used[*corner] = true);
        used.iter().filter(|used| **used).count() as i64 - edges as i64 + self.triangles.len() as i64
    }
}

#[test]
fn indices_of_the_field_add_up_to_the_euler_characteristic() {
    for (name, corners, expected) in [("sphere", sphere(), 2), ("torus", torus(), 0)] {
        let mesh = mesh(&corners);
        assert_eq!(mesh.euler_characteristic(), expected, "{name}");
        let indices = Field::new(&mesh, &[]).indices(&mesh);
        assert!(indices.iter().all(|index| (index - index.round()).abs() < 1e-6), "{name}");
        let sum: f64 = indices.iter().sum();
        assert!((sum - expected as f64).abs() < 1e-6, "{name}: {sum}");
        // a smooth field has no more singularities than it must
        let count = indices.iter().filter(|index| index.abs() > 0.5).count();
        assert_eq!(count as i64, expected, "{name}: singularities");
    }
}

#[cfg(feature = "render")]
#[test]
fn the_teapot_has_the_index_sum_of_its_parts() {
    let object = crate::render::object::load("teapot").unwrap();
    let crate::render::Shape::Mesh(shape) = &object.shape else { panic!("the teapot is no mesh") };
    let corners: Vec<[DVec3; 3]> = shape.corners().map(|corners| corners.map(|p| p.as_dvec3())).collect();
    let whole = mesh(&corners);
    let sums = |mesh: &Mesh| {
        let closed = mesh.closed();
        let sum: f64 = Field::new(&closed, &[]).indices(&closed).iter().sum();
        assert!((sum - closed.euler_characteristic() as f64).abs() < 1e-6, "{sum}");
        sum.round() as i64
    };
    sums(&whole);
    // the body is the largest part, and is open at the top
    let parts = whole.part.iter().max().unwrap() + 1;
    let area = |part: usize| -> f64 {
        (0..whole.triangles.len()).filter(|k| whole.part[*k] == part).map(|k| whole.area(k)).sum()
    };
    let body = (0..parts).max_by(|a, b| area(*a).total_cmp(&area(*b))).unwrap();
    let inside = |k: &usize| whole.part[*k] == body;
    let corners: Vec<[DVec3; 3]> = (0..whole.triangles.len())
        .filter(inside)
        .map(|k| whole.triangles[k].map(|corner| whole.positions[corner]))
        .collect();
    assert_eq!((parts > 1, sums(&mesh(&corners))), (true, 2));
}

#[test]
fn holes_and_parts_are_counted() {
    // a disc closed is a sphere; two spheres are two
    let disc = mesh(&plane(6));
    assert_eq!((disc.euler_characteristic(), disc.closed().euler_characteristic()), (1, 2));
    let apart = sphere().into_iter().map(|corners| corners.map(|p| p + DVec3::X * 5.0));
    let two = mesh(&sphere().into_iter().chain(apart).collect::<Vec<_>>());
    assert_eq!(two.euler_characteristic(), 4);
    let sum: f64 = Field::new(&two, &[]).indices(&two).iter().sum();
    assert!((sum - 4.0).abs() < 1e-6, "{sum}");
}

#[test]
fn meshes_are_repaired_or_refused() {
    let square = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y];
    let [a, b, c, d] = square;
    let warnings = std::cell::RefCell::new(vec![]);
    let warn = |text: &str| warnings.borrow_mut().push(text.to_owned());
    let repaired = Mesh::new(&[[a, b, c], [a, d, c], [a, b, b]], &warn).unwrap();
    assert_eq!(repaired.triangles.len(), 2);
    assert!(repaired.across[0][2].is_some() && repaired.frame(0)[2] == repaired.frame(1)[2]);
    assert_eq!(warnings.borrow().len(), 2, "{warnings:?}");
    let three = Mesh::new(&[[a, b, c], [a, d, c], [a, c, DVec3::Z]], &|_| {}).unwrap_err().to_string();
    assert!(three.starts_with("mesh: 3 triangles meet at the edge from [0, 0, 0] to [1, 1, 0]"), "{three}");
    let empty = Mesh::new(&[[a, b, b]], &|_| {}).unwrap_err().to_string();
    assert_eq!(empty, "mesh: has no triangle with an area");
    // a Moebius strip
    let strip = |k: usize, side: f64| {
        let turn = k as f64 / 12.0 * TAU;
        let flip = if k == 12 { -side } else { side };
        let half = if k == 12 { 0.0 } else { turn / 2.0 };
        let (r, z) = (2.0 + flip * half.cos(), flip * half.sin());
        DVec3::new(r * turn.cos(), r * turn.sin(), z).round_to()
    };
    let strip: Vec<_> = (0..12)
        .flat_map(|k| {
            let [a, b, c, d] = [strip(k, -0.4), strip(k + 1, -0.4), strip(k + 1, 0.4), strip(k, 0.4)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let error = Mesh::new(&strip, &|_| {}).unwrap_err().to_string();
    assert_eq!(error, "mesh: has one side only, like a Moebius strip");
}

/// Coordinates of equal points that are computed differently.
trait Rounded {
    fn round_to(self) -> Self;
}

impl Rounded for DVec3 {
    fn round_to(self) -> Self {
        (self * 1e6).round() / 1e6
    }
}

#[test]
fn strokes_are_followed() {
    let mesh = mesh(&plane(8));
    let stroke = Stroke { at: [0.5, 0.5, 0.0], along: [0.6, 0.8, 0.0] };
    let field = Field::new(&mesh, &[stroke]);
    for (triangle, angle) in field.0.iter().enumerate() {
        let [x, y, _] = mesh.frame(triangle);
        let direction = x * angle.cos() + y * angle.sin();
        assert!((direction - DVec3::from_array(stroke.along)).length() < 1e-3, "{direction}");
    }
}

#[test]
fn ways_over_the_surface_are_straight() {
    let mesh = mesh(&plane(8));
    let field = Field::new(&mesh, &[]);
    let atlas = Atlas::new(&mesh, &field, 128).unwrap();
    // the place in space of a point of a chart
    let place = |triangle: usize, point: glam::DVec2| {
        let [a, b, c] = atlas.charts[triangle].corners;
        let (ab, ac, ap) = (b - a, c - a, point - a);
        let area = ab.perp_dot(ac);
        let (s, t) = (ap.perp_dot(ac) / area, ab.perp_dot(ap) / area);
        let corners = mesh.triangles[triangle].map(|corner| mesh.positions[corner]);
        corners[0] + s * (corners[1] - corners[0]) + t * (corners[2] - corners[0])
    };
    let middle = mesh.triangles.len() / 2 + 8;
    let from = atlas.charts[middle].centre();
    for k in 0..16 {
        let by = glam::DVec2::from_angle(f64::from(k) * TAU / 16.0) * 20.0;
        let [begin, half, whole] = [0.0, 0.5, 1.0].map(|share| {
            let end = atlas.walk(middle, from, by * share).unwrap();
            place(end.triangle, end.point)
        });
        assert!(((begin + whole) / 2.0 - half).length() < 1e-9, "{k}");
        assert!(((whole - begin).length() - 2.0 * (half - begin).length()).abs() < 1e-9, "{k}");
    }
}

/// Smooth stripes across the tangent, with spots.
fn exemplar() -> Exemplar {
    let value = |i: usize| {
        let (x, y) = ((i % 64) as f32, (i / 64) as f32);
        let spot = unit(mix((i / 64 / 4 * 16 + i % 64 / 4) as u64));
        [(y * TAU as f32 / 8.0).sin(), 0.5 * spot + 0.0 * x]
    };
    Exemplar::new(64, 64, 2, (0..64 * 64).flat_map(value).collect())
}

fn made(corners: &[[DVec3; 3]], side: usize) -> OnSurface {
    let corners: Vec<_> = corners.iter().map(|corners| corners.map(|p| p.as_vec3())).collect();
    on_surface(&exemplar(), &corners, &SurfaceGoal { side, seed: 2, strokes: vec![] }, &Silent).unwrap()
}

/// The mean squared difference of the first channel between points on both sides of edges, and between any two points.
fn across_edges(result: &OnSurface) -> [f32; 2] {
    let exemplar = exemplar();
    let value = |uv: Vec2| {
        let x = ((uv.x * result.map.width as f32) as usize).min(result.map.width - 1);
        let y = (((1.0 - uv.y) * result.map.height as f32) as usize).min(result.map.height - 1);
        let source = result.map.at(x, y);
        exemplar.texel(source.x.into(), source.y.into())[0]
    };
    let mut edges: std::collections::BTreeMap<Vec<[u32; 3]>, Vec<f32>> = Default::default();
    for corners in &result.corners {
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let mut key = vec![a.position.to_array().map(f32::to_bits), b.position.to_array().map(f32::to_bits)];
            key.sort_unstable();
            edges.entry(key).or_default().push(value(a.uv.lerp(b.uv, 0.5)));
        }
    }
    let pairs: Vec<_> = edges.into_values().filter(|values| values.len() == 2).collect();
    let mean = |f: &dyn Fn(usize) -> f32| (0..pairs.len()).map(f).sum::<f32>() / pairs.len() as f32;
    [
        mean(&|k| (pairs[k][0] - pairs[k][1]).powi(2)),
        mean(&|k| (pairs[k][0] - pairs[(k * 7 + 3) % pairs.len()][1]).powi(2)),
    ]
}

#[test]
fn stripes_go_on_across_the_edges_of_triangles() {
    for (name, corners) in [("plane", plane(10)), ("torus", torus()), ("sphere", sphere())] {
        let result = made(&corners, 320);
        let [edges, any] = across_edges(&result);
        assert!(edges < 0.25 * any, "{name}: {edges} across edges, {any} anywhere");
        assert_eq!(result.singularities, if name == "torus" { 0 } else { 2 }, "{name}");
        assert!(result.points > 320 * 320 / 10, "{name}: {} points", result.points);
    }
}

#[test]
fn threads_do_not_change_the_result() {
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| made(&torus(), 200)).map
    };
    assert_eq!(with(1), with(2));
}

#[test]
fn unsuitable_sizes_are_refused() {
    let corners: Vec<_> = torus().iter().map(|corners| corners.map(|p| p.as_vec3())).collect();
    let refused = |side: usize| {
        let goal = SurfaceGoal { side, seed: 0, strokes: vec![] };
        on_surface(&exemplar(), &corners, &goal, &Silent).unwrap_err().to_string()
    };
    assert_eq!(refused(5000), "size: found 5000, expected 8 to 4096");
    assert_eq!(refused(16), "size: 16 x 16 texels are too few for 960 triangles");
}

#[test]
fn parts_that_only_touch_have_vertices_of_their_own() {
    let top = sphere().into_iter().map(|corners| corners.map(|p| p + DVec3::Z * 2.0));
    let touching = mesh(&sphere().into_iter().chain(top).collect::<Vec<_>>());
    assert_eq!(touching.euler_characteristic(), 4);
}
