//! The built-in cloth: a square piece of cloth draped over a ball.

use glam::{Vec2, Vec3};

use super::{BuiltIn, Object};
use crate::Result;
use crate::render::{Camera, Mesh, MeshData, Shape};

pub(super) const CLOTH: BuiltIn = BuiltIn {
    name: "cloth",
    doc: "A square cloth draped over a ball; its texture coordinates are those of the flat cloth.",
    build,
};

/// Particles along a side.
const SIDE: usize = 81;

/// Mesh segments between two particles.
const SUBDIVISIONS: usize = 3;

/// Side length of the cloth.
const LENGTH: f32 = 3.1;

/// Texture repeats along a side; one repeat is about the height of the draped cloth.
const REPEATS: f32 = 2.0;

/// The ball under the cloth, resting on the floor at height 0.
const BALL: Vec3 = Vec3::new(0.0, 0.67, 0.0);
const BALL_RADIUS: f32 = 0.67;

/// Half the thickness of the cloth: its distance from ball and floor.
const GAP: f32 = 0.02;

fn build() -> Result<Object> {
    let mesh = Mesh::new(data())?;
    let camera = Camera::around(Vec3::new(0.0, 0.60, 0.0), 1.25, 19.0, 0.0, 1.0);
    Ok(Object { camera, ..Object::standing(Shape::Mesh(mesh.into()), 0.0, Vec::new()) })
}

/// A cloth of particles connected by springs.
///
/// # Model
/// Extended position-based dynamics with one iteration per small time step. Springs along weft and warp are rigid,
/// diagonal springs allow some shear, and springs between every second particle resist bending. Ball and floor push
/// particles out and hold them by friction. The initial cloth is rotated and slightly uneven to break the symmetry of
/// the folds.
///
/// # Limits
/// The cloth does not collide with itself.
///
/// # References
/// macklin2016, macklin2019
struct Cloth {
    position: Vec<Vec3>,
    velocity: Vec<Vec3>,
    springs: Vec<Spring>,
}

struct Spring {
    ends: [u32; 2],
    length: f32,
    /// Inverse stiffness.
    compliance: f32,
}

const STEP: f32 = 1.0 / 600.0;
const STEPS: usize = 1300;
const GRAVITY: f32 = 9.0;
const FRICTION: f32 = 0.5;
/// Air drag at the beginning and at the end, where it brings the cloth to rest.
const DRAG: [f32; 2] = [1.0, 12.0];

impl Cloth {
    fn draped() -> Self {
        let mut cloth = Self::flat();
        for step in 0..STEPS {
            let x = step as f32 / STEPS as f32;
            cloth.step(DRAG[0] + (DRAG[1] - DRAG[0]) * x * x * x);
        }
        cloth
    }

    fn flat() -> Self {
        let cell = LENGTH / (SIDE - 1) as f32;
        // Place the particles
        let turn = Vec2::from_angle(0.30);
        let position = (0..SIDE * SIDE).map(|k| {
            let flat = Vec2::new((k % SIDE) as f32, (k / SIDE) as f32) * cell - Vec2::splat(0.5 * LENGTH);
            let p = turn.rotate(flat);
            let uneven = 0.012 * ((3.1 * p.x + 1.0).sin() * (2.3 * p.y).cos() + (5.3 * p.y + 2.0 * p.x).sin());
            Vec3::new(p.x, BALL.y + BALL_RADIUS + GAP + 0.02 + uneven, p.y)
        });
        // Connect them by springs
        let mut springs = Vec::new();
        for (di, dj, compliance) in [(1, 0, 0.0), (0, 1, 0.0), (1, 1, 3e-6), (1, -1, 3e-6), (2, 0, 4e-5), (0, 2, 4e-5)]
        {
            let length = cell * Vec2::new(di as f32, dj as f32).length();
            // List every second spring first: adjacent springs in the list then share no particle, so the CPU can
            // overlap them.
            for parity in 0..2 {
                for (i, j) in (0..SIDE * SIDE).map(|k| (k % SIDE, k / SIDE)) {
                    let other = (i + di, j.checked_add_signed(dj).unwrap_or(SIDE));
                    let class = i.checked_div(di).unwrap_or(j / 2);
                    if class % 2 == parity && other.0 < SIDE && other.1 < SIDE {
                        let ends = [(i, j), other].map(|(i, j)| (j * SIDE + i) as u32);
                        springs.push(Spring { ends, length, compliance });
                    }
                }
            }
        }
        Self { position: position.collect(), velocity: vec![Vec3::ZERO; SIDE * SIDE], springs }
    }

    fn step(&mut self, drag: f32) {
        // Integrate velocities
        let before = self.position.clone();
        for (p, v) in self.position.iter_mut().zip(&mut self.velocity) {
            v.y -= GRAVITY * STEP;
            *v *= 1.0 - drag * STEP;
            *p += *v * STEP;
        }
        // Satisfy the springs
        for spring in &self.springs {
            let [a, b] = spring.ends.map(|i| i as usize);
            let d = self.position[b] - self.position[a];
            let length = d.length().max(1e-9);
            let push = d * ((length - spring.length) / (length * (2.0 + spring.compliance / (STEP * STEP))));
            self.position[a] += push;
            self.position[b] -= push;
        }
        // Resolve collisions
        for (p, old) in self.position.iter_mut().zip(&before) {
            collide(p, *old);
        }
        for ((p, v), old) in self.position.iter().zip(&mut self.velocity).zip(&before) {
            *v = (*p - *old) / STEP;
        }
    }
}

/// Pushes a particle out of ball and floor, and undoes part of its sliding.
fn collide(p: &mut Vec3, old: Vec3) {
    let from_ball = *p - BALL;
    let depth = BALL_RADIUS + GAP - from_ball.length();
    let (normal, depth) = if depth > 0.0 {
        (from_ball.normalize_or(Vec3::Y), depth)
    } else if p.y < GAP {
        (Vec3::Y, GAP - p.y)
    } else {
        return;
    };
    *p += normal * depth;
    let moved = *p - old;
    let slid = moved - normal * moved.dot(normal);
    let length = slid.length();
    if length > 0.0 {
        // At least the static friction of Coulomb's law, so that the cloth comes to rest.
        *p -= slid * (FRICTION * (depth + 1e-5) / length).min(1.0);
    }
}

/// The mesh of the cloth at rest.
pub(super) fn data() -> MeshData {
    mesh(&Cloth::draped())
}

/// A smooth mesh: a cubic B-spline through the particles.
fn mesh(cloth: &Cloth) -> MeshData {
    let side = (SIDE - 1) * SUBDIVISIONS;
    let mut data = MeshData::default();
    for (i, j) in (0..=side).flat_map(|j| (0..=side).map(move |i| (i, j))) {
        let [x, dx] = cubic(i);
        let [y, dy] = cubic(j);
        let weighted = |x: &[(usize, f32); 4], y: &[(usize, f32); 4]| {
            let row = |j: usize| x.iter().map(|&(i, w)| cloth.position[j * SIDE + i] * w).sum::<Vec3>();
            y.iter().map(|&(j, w)| row(j) * w).sum::<Vec3>()
        };
        data.positions.push(weighted(&x, &y));
        data.normals.push(weighted(&x, &dy).cross(weighted(&dx, &y)).normalize_or(Vec3::Y));
        data.uvs.push(Vec2::new(i as f32, (side - j) as f32) * (REPEATS / side as f32));
    }
    let at = |i: usize, j: usize| (j * (side + 1) + i) as u32;
    for (i, j) in (0..side).flat_map(|j| (0..side).map(move |i| (i, j))) {
        data.triangles.push([at(i, j), at(i + 1, j + 1), at(i + 1, j)]);
        data.triangles.push([at(i, j), at(i, j + 1), at(i + 1, j + 1)]);
    }
    data
}

/// The particles that influence a grid line, with the weights of the uniform cubic B-spline and of its derivative. The
/// spline also smooths out unevenness between particles.
fn cubic(line: usize) -> [[(usize, f32); 4]; 2] {
    let cell = (line / SUBDIVISIONS).min(SIDE - 2);
    let t = line as f32 / SUBDIVISIONS as f32 - cell as f32;
    let s = 1.0 - t;
    let weights = [
        s * s * s / 6.0,
        (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
        (3.0 * s * s * s - 6.0 * s * s + 4.0) / 6.0,
        t * t * t / 6.0,
    ];
    let slopes = [-0.5 * s * s, 1.5 * t * t - 2.0 * t, 2.0 * s - 1.5 * s * s, 0.5 * t * t];
    let particle = |k: usize| (cell + k).saturating_sub(1).min(SIDE - 1);
    [weights, slopes].map(|values| [0, 1, 2, 3].map(|k| (particle(k), values[k])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cloth_lies_still_on_the_ball_and_is_not_stretched() {
        let cloth = Cloth::draped();
        assert!(cloth.position.iter().all(|p| p.y >= GAP - 1e-4 && p.distance(BALL) >= BALL_RADIUS + GAP - 1e-4));
        let fastest = cloth.velocity.iter().map(|v| v.length()).fold(0.0, f32::max);
        assert!(fastest < 0.5, "{fastest}");
        let highest = cloth.position.iter().map(|p| p.y).fold(0.0, f32::max);
        assert!((highest - BALL.y - BALL_RADIUS - GAP).abs() < 0.02, "{highest}");
        let stiff = cloth.springs.iter().filter(|t| t.compliance == 0.0);
        let strain = stiff.map(|t| {
            let [a, b] = t.ends.map(|i| cloth.position[i as usize]);
            a.distance(b) / t.length - 1.0
        });
        let strain: Vec<f32> = strain.collect();
        let mean = strain.iter().sum::<f32>() / strain.len() as f32;
        assert!(mean.abs() < 0.02, "{mean}");
    }

    #[test]
    fn spline_weights_sum_to_one_and_slopes_to_zero() {
        for line in 0..=(SIDE - 1) * SUBDIVISIONS {
            let [weights, slopes] = cubic(line);
            assert!((weights.iter().map(|w| w.1).sum::<f32>() - 1.0).abs() < 1e-6);
            assert!(slopes.iter().map(|w| w.1).sum::<f32>().abs() < 1e-6);
        }
    }
}
