//! Ray tracing of a scene: a hierarchy over its bodies, traversed by bundles of rays.

use std::collections::HashMap;

use glam::{Vec2, Vec3};

use super::bvh::{Bundle, Intersection, RAYS, Row, Triangles, lanes};
use super::light::{AreaLight, Light};
use super::scene::{Body, Scene};
use crate::Result;
use crate::material::Material;

/// Maximum number of bodies in a leaf; a studio has two bodies.
const LEAF: usize = 4;

/// Enough for a balanced tree of 2^32 bodies.
const STACK: usize = 64;

/// Passed for shadow rays that no light is exempt from.
pub(super) const NO_LIGHT: usize = usize::MAX;

/// What a ray hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum What {
    /// Nothing.
    Nothing,
    /// The body of this index in the scene.
    Body(u32),
    /// The light of this index in [`Tracer::areas`].
    Light(u32),
}

/// What the rays of a bundle hit. Distances are those of the bundle.
#[derive(Debug, Clone)]
pub(super) struct Met {
    pub what: [What; RAYS],
    triangles: Triangles,
}

impl Met {
    /// The body that a ray hit.
    #[inline]
    pub(super) fn body<'a>(&self, scene: &'a Scene<'a>, lane: usize) -> Option<&'a Body<'a>> {
        match self.what[lane] {
            What::Body(index) => Some(&scene.bodies[index as usize]),
            _ => None,
        }
    }

    pub(super) const fn nothing() -> Self {
        Self { what: [What::Nothing; RAYS], triangles: Triangles::none() }
    }

    /// The intersection of a ray with the body it hit.
    #[inline]
    pub(super) fn intersection(&self, bundle: &Bundle, lane: usize) -> Intersection {
        self.triangles.hit(bundle, lane)
    }
}

/// A scene with a binary tree of boxes over its bodies.
pub(super) struct Tracer<'a> {
    pub scene: &'a Scene<'a>,
    nodes: Vec<Node>,
    /// Bodies, sorted by leaf.
    order: Vec<u32>,
    /// The lights that rays can hit, with their indices in the scene.
    pub areas: Vec<(usize, &'a AreaLight)>,
    /// The materials of the scene, each once.
    pub materials: Vec<&'a dyn Material>,
    /// For each body its index in `materials`.
    material: Vec<u32>,
    /// Whether all materials are opaque and only reflect light.
    pub only_reflects: bool,
    /// The mean opacity of each material.
    opacity: Vec<f32>,
    /// Whether a light casts no shadows.
    pub shadowless: bool,
}

/// An inner node with children `first` and `first + 1`; if `count` is not 0, a leaf with that many bodies of the
/// order.
#[derive(Debug, Clone, Copy)]
struct Node {
    low: Vec3,
    high: Vec3,
    first: u32,
    count: u32,
}

impl Node {
    /// The smallest distance at which a ray of the bundle enters the box, if any does.
    #[inline]
    fn enter(&self, bundle: &Bundle, inverse: &[Row; 3]) -> Option<f32> {
        let (mut near, mut far) = ([0.0f32; RAYS], bundle.t_max.0);
        for axis in 0..3 {
            let (low, high) = (self.low[axis], self.high[axis]);
            for lane in 0..RAYS {
                let (origin, inverse) = (bundle.origin[axis].0[lane], inverse[axis].0[lane]);
                let (a, b) = ((low - origin) * inverse, (high - origin) * inverse);
                near[lane] = near[lane].max(a.min(b));
                far[lane] = far[lane].min(a.max(b) * (1.0 + 4.0 * f32::EPSILON));
            }
        }
        let entries = (0..RAYS).filter(|&lane| near[lane] <= far[lane] && bundle.t_max.0[lane] > 0.0);
        entries.map(|lane| near[lane]).reduce(f32::min)
    }
}

impl<'a> Tracer<'a> {
    pub(super) fn new(scene: &'a Scene<'a>) -> Self {
        let boxes: Vec<[Vec3; 2]> = scene.bodies.iter().map(|body| body.shape.extent()).collect();
        let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
        let mut nodes = vec![Node { low: Vec3::ZERO, high: Vec3::ZERO, first: 0, count: 0 }];
        split(&boxes, &mut order, 0, 0, &mut nodes);
        let area = |(index, light): (usize, &'a Light)| match light {
            Light::Area(area) => Some((index, area)),
            _ => None,
        };
        let areas = scene.lights.iter().enumerate().filter_map(area).collect();
        let (materials, material) = distinct(scene);
        let only_reflects = materials.iter().all(|material| material.only_reflects());
        let opacity = materials.iter().map(|m| m.own(Vec2::splat(0.5), Vec3::Z).opacity.element_sum() / 3.0).collect();
        let shadowless = scene.lights.iter().any(|light| !light.casts_shadows());
        Self { scene, nodes, order, areas, materials, material, only_reflects, opacity, shadowless }
    }

    /// Makes materials build their sampling tables, in parallel, by drawing once from each.
    pub(super) fn build_samplers(&self) -> Result<()> {
        for material in &self.materials {
            material.sample(Vec2::ZERO, Vec3::Z, Vec2::splat(0.5));
        }
        self.check_materials()
    }

    /// Fails if a material has failed.
    pub(super) fn check_materials(&self) -> Result<()> {
        self.materials.iter().try_for_each(|material| material.check())
    }

    /// The index of a body's material in [`Tracer::materials`].
    #[inline]
    pub(super) fn material_of(&self, body: u32) -> u32 {
        self.material[body as usize]
    }

    /// Finds the nearest body or light of each ray, and shortens the rays.
    pub(super) fn closest(&self, bundle: &mut Bundle, met: &mut Met) {
        met.what = [What::Nothing; RAYS];
        let Met { what, triangles } = met;
        let mut note = |hits: u16, found: What| {
            lanes(hits).for_each(|lane| what[lane] = found);
        };
        self.walk(bundle, |index, bundle| {
            note(self.scene.bodies[index as usize].shape.closest_of(bundle, triangles), What::Body(index));
        });
        for (index, (_, area)) in self.areas.iter().enumerate() {
            for lane in 0..RAYS {
                if let Some(t) = area.shape.closest(&bundle.ray(lane), bundle.t_max.0[lane]) {
                    bundle.t_max.0[lane] = t;
                    note(1 << lane, What::Light(index as u32));
                }
            }
        }
    }

    /// Returns a bit for each ray that is occluded, except by the light of index `except`. Occluded rays have length 0
    /// afterwards.
    pub(super) fn occluded(&self, bundle: &mut Bundle, except: usize) -> u16 {
        let mut all = 0;
        let mut end = |bundle: &mut Bundle, hits: u16| {
            all |= hits;
            lanes(hits).for_each(|lane| bundle.t_max.0[lane] = 0.0);
        };
        self.walk(bundle, |index, bundle| {
            let mut hits = self.scene.bodies[index as usize].shape.occluded_of(bundle);
            if hits != 0 && !self.only_reflects {
                hits &= !self.let_through(index, bundle);
            }
            end(bundle, hits);
        });
        for (_, area) in self.areas.iter().filter(|(index, _)| *index != except) {
            for lane in 0..RAYS {
                if area.shape.closest(&bundle.ray(lane), bundle.t_max.0[lane]).is_some() {
                    end(bundle, 1 << lane);
                }
            }
        }
        all
    }

    /// Returns a bit for each ray of a bundle that a transparent body lets through, by chance: a number that belongs to
    /// the ray and the body decides, so that the result does not depend on the order of rays.
    #[cold]
    fn let_through(&self, body: u32, bundle: &Bundle) -> u16 {
        let opacity = self.opacity[self.material_of(body) as usize];
        if opacity >= 1.0 {
            return 0;
        }
        let passes = |lane: &usize| {
            let ray = bundle.ray(*lane);
            let numbers = ray.origin.to_array().into_iter().chain(ray.direction.to_array()).map(f32::to_bits);
            let mixed = numbers
                .fold(u64::from(body), |h, n| (h ^ u64::from(n)).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29));
            let chance = (mixed.wrapping_mul(0xd6e8_feb8_6659_fd93) >> 40) as f32 / (1u64 << 24) as f32;
            chance >= opacity
        };
        (0..RAYS).filter(passes).fold(0, |bits, lane| bits | 1 << lane)
    }

    /// Visits the bodies whose boxes the rays hit, near ones first. A visit may shorten the rays.
    #[inline]
    fn walk(&self, bundle: &mut Bundle, mut visit: impl FnMut(u32, &mut Bundle)) {
        let mut leaf = |node: &Node, bundle: &mut Bundle| {
            let bodies = &self.order[node.first as usize..][..node.count as usize];
            bodies.iter().for_each(|&index| visit(index, bundle));
        };
        if self.nodes.len() == 1 {
            return leaf(&self.nodes[0], bundle);
        }
        let inverse = bundle.inverse();
        let mut stack = [(0.0f32, 0u32); STACK];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (entry, index) = stack[height];
            if bundle.t_max.0.iter().all(|&t| entry >= t) {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                leaf(node, bundle);
                continue;
            }
            let child = |k: u32| {
                let index = node.first + k;
                self.nodes[index as usize].enter(bundle, &inverse).map(|entry| (entry, index))
            };
            let (a, b) = (child(0), child(1));
            let a_first = matches!((a, b), (Some(a), Some(b)) if a.0 <= b.0);
            for waiting in (if a_first { [b, a] } else { [a, b] }).into_iter().flatten() {
                stack[height] = waiting;
                height += 1;
            }
        }
    }
}

/// The materials of a scene, each once, and for each body the index of its own. Materials of different types are
/// different, although they may share an address if they have no size.
fn distinct<'a>(scene: &'a Scene<'a>) -> (Vec<&'a dyn Material>, Vec<u32>) {
    let (mut materials, mut known) = (Vec::new(), HashMap::new());
    let mut index = |body: &Body<'a>| {
        let own: *const dyn Material = body.material;
        *known.entry(own).or_insert_with(|| {
            materials.push(body.material);
            materials.len() as u32 - 1
        })
    };
    let of_body = scene.bodies.iter().map(&mut index).collect();
    (materials, of_body)
}

/// Halves the bodies of `order` along the longest side of the box of their centres, recursively. Node `at` holds them;
/// `first` is the number of bodies before them.
fn split(boxes: &[[Vec3; 2]], order: &mut [u32], first: usize, at: usize, nodes: &mut Vec<Node>) {
    let of = |i: &u32| boxes[*i as usize];
    let empty = [Vec3::INFINITY, Vec3::NEG_INFINITY];
    let [low, high] = order.iter().map(of).fold(empty, |[a, b], [low, high]| [a.min(low), b.max(high)]);
    if order.len() <= LEAF {
        nodes[at] = Node { low, high, first: first as u32, count: order.len() as u32 };
        return;
    }
    let middle = |i: &u32| of(i)[0] + of(i)[1];
    let [least, most] = order.iter().map(middle).fold(empty, |[a, b], m| [a.min(m), b.max(m)]);
    let size = most - least;
    let axis = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
    let half = order.len() / 2;
    order.select_nth_unstable_by(half, |a, b| middle(a)[axis].total_cmp(&middle(b)[axis]).then(a.cmp(b)));
    let child = nodes.len();
    nodes[at] = Node { low, high, first: child as u32, count: 0 };
    nodes.extend([nodes[at]; 2]);
    let (left, right) = order.split_at_mut(half);
    split(boxes, left, first, child, nodes);
    split(boxes, right, first + half, child + 1, nodes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Lambert;
    use crate::render::ray::Ray;
    use crate::render::{Camera, Environment, Shape, Sphere, TextureMap};

    #[test]
    fn the_tree_finds_what_a_search_of_all_finds() {
        let random =
            |k: u32| (k.wrapping_mul(2_654_435_769).rotate_left(11).wrapping_mul(40_503) >> 8) as f32 / 2f32.powi(24);
        let white = Lambert { albedo: Vec3::ONE };
        let point = |k: u32| Vec3::new(random(k), random(k + 1000), random(k + 2000)) * 2.0 - 1.0;
        let sphere = |k: u32| Shape::Sphere(Sphere { centre: point(k), radius: 0.08 * random(k + 77), axis: Vec3::Y });
        for count in [0, 1, 4, 5, 33, 500] {
            let body = |k: u32| Body {
                shape: sphere(k),
                material: &white,
                material_name: String::new(),
                texture: TextureMap::default(),
            };
            let scene = Scene {
                bodies: (0..count).map(body).collect(),
                lights: Vec::new(),
                environment: Environment::Dark,
                background: None,
                camera: Camera::pinhole(Vec3::ZERO, Vec3::Z, 30.0),
            };
            let tracer = Tracer::new(&scene);
            for first in (5000..5400).step_by(RAYS) {
                let ray = |k: u32| {
                    let direction = (point(k) - point(k + 9)).normalize_or(Vec3::X);
                    Ray { origin: 1.5 * point(k + 9), direction }
                };
                let mut bundle = Bundle::EMPTY;
                // the last one is left out
                for lane in 0..RAYS - 1 {
                    bundle.set(lane, &ray(first + lane as u32), f32::INFINITY);
                }
                let occluded = tracer.occluded(&mut bundle.clone(), NO_LIGHT);
                let mut met = Met::nothing();
                tracer.closest(&mut bundle, &mut met);
                for lane in 0..RAYS - 1 {
                    let ray = ray(first + lane as u32);
                    let found = scene.bodies.iter().filter_map(|b| b.shape.closest(&ray, f32::INFINITY));
                    let expected = found.map(|m| m.t).min_by(f32::total_cmp);
                    assert_eq!(met.what[lane] != What::Nothing, expected.is_some());
                    assert_eq!(bundle.t_max.0[lane], expected.unwrap_or(f32::INFINITY));
                    assert_eq!(occluded >> lane & 1 != 0, expected.is_some());
                }
                assert_eq!((met.what[RAYS - 1], occluded >> (RAYS - 1)), (What::Nothing, 0));
            }
        }
    }
}
