//! A scene made ready for rays: a hierarchy over its bodies.

use glam::Vec3;

use super::Ray;
use super::light::{AreaLight, Light};
use super::scene::{Body, Scene};
use super::shape::{Hit, Meeting};

/// Bodies tested one after the other; a studio has two.
const LEAF: usize = 4;

/// Enough for a balanced tree of 2^32 bodies.
const STACK: usize = 64;

/// No light is spared by a shadow ray.
pub(super) const NO_LIGHT: usize = usize::MAX;

/// What a ray met.
pub(super) enum Met<'a> {
    /// A body, and where.
    Body(&'a Body<'a>, Hit, Meeting),
    /// A light, at this distance.
    Light(&'a AreaLight, f32),
}

/// A scene with a binary tree of boxes over its bodies.
pub(super) struct Tracer<'a> {
    pub scene: &'a Scene<'a>,
    nodes: Vec<Node>,
    /// Bodies in the order of the leaves.
    order: Vec<u32>,
    /// The lights that can be met, with their places in the scene's list.
    areas: Vec<(usize, &'a AreaLight)>,
}

/// Children `first` and `first + 1`, or, if `count` is not 0, so many bodies of the order.
#[derive(Debug, Clone, Copy)]
struct Node {
    low: Vec3,
    high: Vec3,
    first: u32,
    count: u32,
}

impl Node {
    /// Where a ray enters the box, if before `t_max`.
    #[inline]
    fn enter(&self, origin: Vec3, inverse: Vec3, t_max: f32) -> Option<f32> {
        let (a, b) = ((self.low - origin) * inverse, (self.high - origin) * inverse);
        let near = a.min(b).max_element().max(0.0);
        let far = a.max(b).min_element() * (1.0 + 4.0 * f32::EPSILON);
        (near <= far.min(t_max)).then_some(near)
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
        Self { scene, nodes, order, areas: scene.lights.iter().enumerate().filter_map(area).collect() }
    }

    /// The nearest surface, a body's or a light's.
    #[inline(always)]
    pub(super) fn closest(&self, ray: &Ray) -> Option<Met<'a>> {
        let mut best: Option<(&'a Body<'a>, Meeting)> = None;
        self.walk(ray, f32::INFINITY, |body, t_max| {
            if let Some(meeting) = body.shape.closest(ray, *t_max) {
                *t_max = meeting.t();
                best = Some((body, meeting));
            }
            false
        });
        let mut t_max = best.as_ref().map_or(f32::INFINITY, |(_, meeting)| meeting.t());
        let mut light = None;
        for (_, area) in &self.areas {
            if let Some(t) = area.shape.closest(ray, t_max) {
                t_max = t;
                light = Some(Met::Light(area, t));
            }
        }
        light.or_else(|| best.map(|(body, meeting)| Met::Body(body, body.shape.surface(ray, &meeting), meeting)))
    }

    /// Whether anything is in the way of a ray for the distance `t_max`, other than the light of index `except`.
    #[inline(always)]
    pub(super) fn occluded(&self, ray: &Ray, t_max: f32, except: usize) -> bool {
        self.walk(ray, t_max, |body, t_max| body.shape.occluded(ray, *t_max))
            || self.areas.iter().any(|(index, area)| *index != except && area.shape.closest(ray, t_max).is_some())
    }

    /// Visits the bodies whose boxes are met before the distance that `visit` may shorten, near ones first, until it
    /// says that it is done; whether it did.
    #[inline(always)]
    fn walk(&self, ray: &Ray, mut t_max: f32, mut visit: impl FnMut(&'a Body<'a>, &mut f32) -> bool) -> bool {
        let mut leaf = |node: &Node, t_max: &mut f32| {
            let bodies = &self.order[node.first as usize..][..node.count as usize];
            for &i in bodies {
                if visit(&self.scene.bodies[i as usize], t_max) {
                    return true;
                }
            }
            false
        };
        if self.nodes.len() == 1 {
            return leaf(&self.nodes[0], &mut t_max);
        }
        let away = |d: f32| if d.abs() < 1e-18 { 1e-18f32.copysign(d) } else { d };
        let d = ray.direction;
        let inverse = Vec3::new(away(d.x), away(d.y), away(d.z)).recip();
        let mut stack = [(0.0f32, 0u32); STACK];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (entry, index) = stack[height];
            if entry >= t_max {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                if leaf(node, &mut t_max) {
                    return true;
                }
                continue;
            }
            let child = |k: u32| {
                let index = node.first + k;
                self.nodes[index as usize].enter(ray.origin, inverse, t_max).map(|entry| (entry, index))
            };
            let (a, b) = (child(0), child(1));
            let a_first = matches!((a, b), (Some(a), Some(b)) if a.0 <= b.0);
            for waiting in (if a_first { [b, a] } else { [a, b] }).into_iter().flatten() {
                stack[height] = waiting;
                height += 1;
            }
        }
        false
    }
}

/// Halves the bodies of `order` along the longest side of their middles' box until few are left; node `at` holds them,
/// and `first` counts the bodies before them.
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
    use crate::material::Lambert;
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
            for k in 5000..5400 {
                let Some(direction) = (point(k) - point(k + 9)).try_normalize() else { continue };
                let ray = Ray { origin: 1.5 * point(k + 9), direction };
                let meetings = scene.bodies.iter().filter_map(|b| b.shape.closest(&ray, f32::INFINITY));
                let expected = meetings.map(|m| m.t()).min_by(f32::total_cmp);
                let found = match tracer.closest(&ray) {
                    Some(Met::Body(_, hit, _)) => Some((hit.position - ray.origin).length()),
                    _ => None,
                };
                assert_eq!(found.is_some(), expected.is_some());
                assert!((found.unwrap_or(0.0) - expected.unwrap_or(0.0)).abs() < 1e-4);
                assert_eq!(tracer.occluded(&ray, f32::INFINITY, NO_LIGHT), expected.is_some());
            }
        }
    }
}
