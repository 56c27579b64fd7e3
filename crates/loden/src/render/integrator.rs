//! Path tracing.

use std::f32::consts::PI;
use std::ops::Range;

use glam::{Vec2, Vec3};

use super::bvh::{Bundle, RAYS, Row, lanes};
use super::environment::Environment;
use super::filter::Pixel;
use super::light::Arriving;
use super::own_light::{add_own, is_seen_directly, shut_out};
use super::path::Path;
use super::ray::Ray;
use super::sampler::Sampler;
use super::scene::Scene;
use super::surface::Surfaces;
use super::tracer::{Met, NO_LIGHT, Tracer, What};
use super::vertex::{Fault, Group, Vertex};
use crate::material::{Bounce, Point};
use crate::simd::many::Many;

/// First segment at which Russian roulette may end a path.
const ROULETTE_FROM: u32 = 4;

/// Shadow rays end this much before a light, so that a surface under the light is not shadowed by it.
const SHORTER: f32 = 1.0 - 1e-4;

/// Batch size of calls of materials.
const BATCH: usize = 64;

/// Traces paths, many at a time.
///
/// # Model
/// The rendering equation is estimated by paths of at most `depth` segments, camera ray included. At every surface,
/// each light and the environment map are sampled. Area lights and the map are also hit by directions drawn from the
/// material; both estimates are combined by multiple importance sampling (power heuristic). A constant sky is sampled
/// by the material alone. From the fourth segment on, Russian roulette ends paths, without bias.
///
/// All paths advance together, segment by segment: sixteen rays are traced at once, from the second segment on rays of
/// similar directions, and each material prepares all its points at once. The result for a path does not depend on the
/// other paths.
///
/// # Limits
/// Directional lights, points and spots are only sampled directly, so a perfect mirror does not show them. Negative
/// material values count as 0. Light that a body emits by itself is found by chance alone. A ray that passes a
/// transparent body uses up a segment.
///
/// # References
/// kajiya1986, veach1997 sections 9.2 and 10.2; laine2013 for paths that advance together
pub(super) struct Paths<'a> {
    tracer: &'a Tracer<'a>,
    depth: u32,
    paths: Vec<Path>,
    /// Rays of the next segment.
    kept: Vec<Path>,
    /// The order in which rays are traced.
    order: Vec<u16>,
    /// The cell of each ray's direction.
    keys: Vec<u8>,
    /// Sorted by material.
    vertices: Vec<Vertex<'a>>,
    /// What the materials prepare: the points of each vertex, one vertex after the other.
    points: Vec<Point>,
    shadows: Vec<Shadow>,
    /// Unoccluded shadow rays.
    lit: Vec<Shadow>,
    /// Two random numbers for each vertex.
    random: Vec<Vec2>,
}

/// The largest number of paths traced together; it is counted with 16 bits.
pub(super) const PATHS: usize = 4096;

/// Generates camera rays.
pub(super) trait Camera {
    /// The rays of at most [`RAYS`] camera samples, and their samplers after the numbers used.
    fn start(&self, places: Range<usize>, rays: &mut Many<Ray, 6>, samplers: &mut Many<Sampler, 3>);

    /// The position of a camera sample within its pixel.
    fn pixel(&self, place: usize) -> Pixel<'_>;
}

/// A connection from a vertex to a light.
#[derive(Clone, Copy)]
struct Shadow {
    vertex: u32,
    direction: Vec3,
    /// `direction` in the frame of the vertex.
    wi: Vec3,
    distance: f32,
    /// Irradiance that the light adds where nothing is in between.
    irradiance: Vec3,
    /// The density with which it was drawn; 0 where no material could have drawn it.
    pdf: f32,
}

// the steps are inlined into their caller, which is compiled for AVX2 and AVX-512, too
impl<'a> Paths<'a> {
    pub(super) fn new(tracer: &'a Tracer<'a>, depth: u32) -> Self {
        let (paths, kept) = (Vec::with_capacity(PATHS), Vec::with_capacity(PATHS));
        Self {
            tracer,
            depth,
            paths,
            kept,
            order: Vec::new(),
            keys: Vec::new(),
            vertices: Vec::with_capacity(PATHS),
            points: Vec::with_capacity(PATHS),
            shadows: Vec::new(),
            lit: Vec::new(),
            random: Vec::new(),
        }
    }

    /// The radiance that arrives along each of at most [`PATHS`] camera rays.
    #[inline(always)]
    pub(super) fn radiance(&mut self, camera: &impl Camera, sums: &mut [Vec3]) -> Result<(), Box<Fault>> {
        sums.fill(Vec3::ZERO);
        self.start(camera, sums.len());
        for segment in 1..=self.depth {
            self.sort(segment);
            self.meet(segment, camera, sums);
            if self.vertices.is_empty() && self.kept.is_empty() {
                break;
            }
            let points = std::mem::take(&mut self.points);
            let groups = self.prepare(&points);
            self.connect(&groups, sums)?;
            self.scatter(&groups, segment)?;
            drop(groups);
            self.points = points;
        }
        Ok(())
    }

    /// Generates camera rays.
    #[inline(always)]
    fn start(&mut self, camera: &impl Camera, count: usize) {
        self.paths.clear();
        let (mut rays, mut samplers) = (Many::ZERO, Many::ZERO);
        for first in (0..count).step_by(RAYS) {
            let places = first..count.min(first + RAYS);
            camera.start(places.clone(), &mut rays, &mut samplers);
            self.paths.extend(places.map(|place| Path {
                ray: rays.get(place - first),
                throughput: Vec3::ONE,
                drawn: None,
                sampler: samplers.get(place - first),
                place: place as u32,
            }));
        }
    }

    /// Sorts rays by direction, and otherwise by pixel. Camera rays are sorted already.
    #[inline(always)]
    fn sort(&mut self, segment: u32) {
        let Self { paths, order, keys, .. } = self;
        order.clear();
        order.extend(0..paths.len() as u16);
        if segment == 1 {
            return;
        }
        keys.clear();
        keys.extend(paths.iter().map(|path| direction_key(path.ray.direction)));
        let mut places = [0; 65];
        keys.iter().for_each(|&key| places[usize::from(key) + 1] += 1);
        (1..places.len()).for_each(|k| places[k] += places[k - 1]);
        for (index, &key) in (0..).zip(keys.iter()) {
            let place = &mut places[usize::from(key)];
            order[*place] = index;
            *place += 1;
        }
    }

    /// Follows all rays to the vertices at their ends. Paths that leave the scene or meet a light end.
    #[inline(always)]
    fn meet(&mut self, segment: u32, camera: &impl Camera, sums: &mut [Vec3]) {
        let Self { tracer, depth, paths, kept, order, vertices, .. } = self;
        let scene = tracer.scene;
        vertices.clear();
        kept.clear();
        let (mut bundle, mut met, mut surfaces) = (Bundle::EMPTY, Met::nothing(), Surfaces::new());
        for indices in order.chunks(RAYS) {
            // Find the nearest surfaces
            bundle.t_max = Row::ZERO;
            for (lane, &index) in indices.iter().enumerate() {
                bundle.set(lane, &paths[index as usize].ray, f32::INFINITY);
            }
            tracer.closest(&mut bundle, &mut met);
            // Add emitted light and the environment
            let mut bodies = 0;
            for (lane, &index) in indices.iter().enumerate() {
                let Path { ray, throughput, drawn, place, .. } = &paths[index as usize];
                let sum = &mut sums[*place as usize];
                match met.what[lane] {
                    What::Body(_) => bodies |= 1 << lane,
                    What::Light(light) => {
                        let (_, light) = tracer.areas[light as usize];
                        let (radiance, pdf) = light.seen(ray, bundle.t_max.0[lane]);
                        *sum += *throughput * radiance * drawn.map_or(1.0, |drawn| power_heuristic(drawn, pdf));
                    }
                    What::Nothing => *sum += *throughput * escaped(scene, ray.direction, *drawn),
                }
            }
            if (segment == *depth && tracer.only_reflects) || bodies == 0 {
                continue;
            }
            surfaces.find(scene, &bundle, &met, bodies, |lane| paths[indices[lane] as usize].sampler.next_1d());
            for lane in lanes(bodies) {
                let What::Body(index) = met.what[lane] else { continue };
                let body = &scene.bodies[index as usize];
                let path = indices[lane];
                let mut shading = surfaces.shadings.get(lane);
                let texels = body.material.texels();
                if !body.texture.wrap(&mut shading, texels) {
                    continue;
                }
                if !tracer.only_reflects {
                    let hit = surfaces.hits.get(lane);
                    let (path, sums) = (&mut paths[path as usize], &mut *sums);
                    if let Some(passed) = add_own(body, &shading, &hit, path, sums) {
                        kept.push(passed);
                        continue;
                    }
                    if segment == *depth {
                        continue;
                    }
                }
                let Path { sampler, place, drawn, .. } = &mut paths[path as usize];
                let direct = is_seen_directly(*drawn);
                let inside = tracer.shadowless && {
                    let hit = surfaces.hits.get(lane);
                    hit.normal.dot(hit.geometric) < 0.0
                };
                let others = if segment == 1 && body.texture.samples > 1 {
                    let (pixel, hit) = (camera.pixel(*place as usize), surfaces.hits.get(lane));
                    let at = met.intersection(&bundle, lane);
                    pixel.others(body, (&hit, &at), texels, || sampler.next_2d())
                } else {
                    Vec::new()
                };
                let material = tracer.material_of(index);
                vertices.push(Vertex {
                    body,
                    material,
                    path,
                    direct,
                    inside,
                    shading,
                    others,
                    point: 0,
                    lit: Vec3::ZERO,
                });
            }
        }
        self.collect_points();
    }

    /// Sorts the vertices by material, and collects their points.
    #[inline(always)]
    fn collect_points(&mut self) {
        let Self { vertices, points, .. } = self;
        points.clear();
        if !vertices.is_sorted_by_key(|vertex| vertex.material) {
            vertices.sort_by_key(|vertex| vertex.material);
        }
        for group in vertices.chunk_by_mut(|a, b| a.material == b.material) {
            let first = points.len();
            for vertex in group {
                let wo = vertex.shading.wo;
                vertex.point = (points.len() - first) as u32;
                points.push(Point { uv: vertex.shading.uv, wo });
                points.extend(vertex.others.iter().map(|&uv| Point { uv, wo }));
            }
        }
    }

    /// Lets each material prepare its points.
    #[inline(always)]
    fn prepare<'p>(&self, mut points: &'p [Point]) -> Vec<Group<'p>>
    where
        'a: 'p,
    {
        let mut groups = Vec::new();
        let mut first = 0;
        for vertices in self.vertices.chunk_by(|a, b| a.material == b.material) {
            let count = vertices.iter().map(|vertex| 1 + vertex.others.len()).sum();
            let (own, rest) = points.split_at(count);
            points = rest;
            let material = vertices[0].body.material;
            let range = first..first + vertices.len();
            first = range.end;
            groups.push(Group { vertices: range, points: own, prepared: material.prepare(own) });
        }
        groups
    }

    /// Adds direct illumination at all vertices.
    #[inline(always)]
    fn connect(&mut self, groups: &[Group], sums: &mut [Vec3]) -> Result<(), Box<Fault>> {
        let scene = self.tracer.scene;
        // Sample the light sources
        for (index, light) in scene.lights.iter().enumerate() {
            self.connect_to(groups, index, light.casts_shadows(), |at, sampler| {
                let Arriving { direction, distance, irradiance, pdf } = light.arriving(at, || sampler.next_2d())?;
                Some((direction, distance * SHORTER, irradiance, pdf))
            })?;
        }
        self.add_lit(sums);
        // Sample the environment map
        if let Environment::Map(map) = &scene.environment {
            self.connect_to(groups, NO_LIGHT, true, |_, sampler| {
                let (direction, pdf) = map.sample(sampler.next_2d())?;
                (pdf > 0.0).then(|| (direction, f32::INFINITY, map.radiance(direction) / pdf, pdf))
            })?;
            self.add_lit(sums);
        }
        Ok(())
    }

    #[inline(always)]
    fn add_lit(&mut self, sums: &mut [Vec3]) {
        for vertex in &mut self.vertices {
            let path = &self.paths[vertex.path as usize];
            sums[path.place as usize] += path.throughput * std::mem::take(&mut vertex.lit);
        }
    }

    /// Adds what arrives at all vertices from the directions that `draw` gives: direction, distance, irradiance and
    /// density. The light of index `light` casts no shadow on itself. One that casts no shadows at all lights only what is
    /// seen directly, and only a body seen from its inside keeps it out.
    #[inline(always)]
    fn connect_to(
        &mut self,
        groups: &[Group],
        light: usize,
        casts_shadows: bool,
        draw: impl Fn(Vec3, &mut Sampler) -> Option<(Vec3, f32, Vec3, f32)>,
    ) -> Result<(), Box<Fault>> {
        let Self { tracer, paths, vertices, shadows, lit, .. } = self;
        // Draw points of the light
        shadows.clear();
        for (index, vertex) in vertices.iter().enumerate().filter(|(_, vertex)| casts_shadows || vertex.direct) {
            let sampler = &mut paths[vertex.path as usize].sampler;
            let Some((direction, distance, irradiance, pdf)) = draw(vertex.shading.origin, sampler) else { continue };
            let wi = vertex.shading.frame.local(direction);
            if wi.z > 0.0 {
                shadows.push(Shadow { vertex: index as u32, direction, wi, distance, irradiance, pdf });
            }
        }
        // Trace shadow rays
        lit.clear();
        let mut bundle = Bundle::EMPTY;
        for shadows in shadows.chunks(RAYS) {
            bundle.t_max = Row::ZERO;
            for (lane, shadow) in shadows.iter().enumerate() {
                let origin = vertices[shadow.vertex as usize].shading.origin;
                bundle.set(lane, &Ray { origin, direction: shadow.direction }, shadow.distance);
            }
            let occluded = if casts_shadows {
                tracer.occluded(&mut bundle, light)
            } else {
                shut_out(&bundle, shadows.iter().map(|shadow| &vertices[shadow.vertex as usize]))
            };
            lit.extend(shadows.iter().enumerate().filter(|(lane, _)| occluded >> lane & 1 == 0).map(|(_, s)| *s));
        }
        // Add reflected light
        let mut rest = &lit[..];
        for group in groups {
            let (own, others) = rest.split_at(rest.partition_point(|s| (s.vertex as usize) < group.vertices.end));
            rest = others;
            own.chunks(BATCH).try_for_each(|shadows| reflect(group, vertices, shadows))?;
        }
        Ok(())
    }

    /// Draws the directions in which paths go on.
    #[inline(always)]
    fn scatter(&mut self, groups: &[Group], segment: u32) -> Result<(), Box<Fault>> {
        self.draw_numbers();
        let Self { paths, kept, vertices, random, .. } = self;
        for group in groups {
            let (vertices, random) = (&vertices[group.vertices.clone()], &random[group.vertices.clone()]);
            for (vertices, random) in vertices.chunks(BATCH).zip(random.chunks(BATCH)) {
                // Sample the material
                let (mut index, mut bounces) = ([0; BATCH], [Bounce::NONE; BATCH]);
                index.iter_mut().zip(vertices).for_each(|(index, vertex)| *index = vertex.point);
                group.prepared.scatter(&index[..vertices.len()], random, &mut bounces[..vertices.len()]);
                for (vertex, bounce) in vertices.iter().zip(&bounces).filter(|(_, bounce)| bounce.pdf > 0.0) {
                    let Path { throughput, place, mut sampler, .. } = paths[vertex.path as usize];
                    let value = group.mean(vertex, bounce.wi, bounce.value)?;
                    let mut throughput = throughput * value / (PI * bounce.pdf);
                    // Terminate the path by Russian roulette
                    if segment >= ROULETTE_FROM {
                        let survival = throughput.max_element().min(0.95);
                        if sampler.next_1d() >= survival {
                            continue;
                        }
                        throughput /= survival;
                    }
                    if throughput == Vec3::ZERO {
                        continue;
                    }
                    let direction = vertex.shading.frame.world(bounce.wi).normalize();
                    let ray = Ray { origin: vertex.shading.origin, direction };
                    kept.push(Path { ray, throughput, drawn: Some(bounce.pdf), sampler, place });
                }
            }
        }
        std::mem::swap(paths, kept);
        Ok(())
    }

    /// Draws two random numbers for each vertex.
    #[inline(always)]
    fn draw_numbers(&mut self) {
        let Self { paths, vertices, random, .. } = self;
        random.clear();
        let (mut samplers, mut numbers) = (Many::<Sampler, 3>::ZERO, Many::<Vec2, 2>::ZERO);
        for vertices in vertices.chunks(RAYS) {
            for (lane, vertex) in vertices.iter().enumerate() {
                samplers.set(lane, paths[vertex.path as usize].sampler);
            }
            for lane in 0..RAYS {
                let mut sampler = samplers.get(lane);
                numbers.set(lane, sampler.next_2d());
                samplers.set(lane, sampler);
            }
            for (lane, vertex) in vertices.iter().enumerate() {
                paths[vertex.path as usize].sampler = samplers.get(lane);
                random.push(numbers.get(lane));
            }
        }
    }
}

/// Adds the light of at most [`BATCH`] connections to their vertices.
#[inline(always)]
fn reflect(group: &Group, vertices: &mut [Vertex], shadows: &[Shadow]) -> Result<(), Box<Fault>> {
    let count = shadows.len();
    let (mut index, mut wi) = ([0; BATCH], [Vec3::Z; BATCH]);
    for (lane, shadow) in shadows.iter().enumerate() {
        (index[lane], wi[lane]) = (vertices[shadow.vertex as usize].point, shadow.wi);
    }
    let (index, wi) = (&index[..count], &wi[..count]);
    let (mut values, mut densities) = ([Vec3::ZERO; BATCH], [0.0; BATCH]);
    group.prepared.apparent(index, wi, &mut values[..count]);
    if shadows.iter().any(|shadow| shadow.pdf > 0.0) {
        group.prepared.pdf(index, wi, &mut densities[..count]);
    }
    for ((shadow, value), density) in shadows.iter().zip(values).zip(densities) {
        let vertex = &mut vertices[shadow.vertex as usize];
        let value = group.mean(vertex, shadow.wi, value)?;
        let weight = if shadow.pdf > 0.0 { power_heuristic(shadow.pdf, density) } else { 1.0 };
        vertex.lit += value * shadow.irradiance * (weight / PI);
    }
    Ok(())
}

/// The cell of an octahedral map: similar directions share a cell.
#[inline]
fn direction_key(d: Vec3) -> u8 {
    let d = d / (d.x.abs() + d.y.abs() + d.z.abs());
    let fold = |a: f32, b: f32| if d.z < 0.0 { (1.0 - b.abs()).copysign(a) } else { a };
    let cell = |x: f32| ((x * 4.0 + 4.0) as i32).clamp(0, 7) as u8;
    let (x, y) = (cell(fold(d.x, d.y)), cell(fold(d.y, d.x)));
    // row by row, back and forth
    y << 3 | if y & 1 == 0 { x } else { 7 - x }
}

/// Radiance of the environment along a ray that left the scene, weighted.
#[inline]
fn escaped(scene: &Scene, direction: Vec3, drawn: Option<f32>) -> Vec3 {
    let weight = match (&scene.environment, drawn, scene.background) {
        (_, None, Some(background)) => return background,
        (Environment::Map(map), Some(pdf), _) => power_heuristic(pdf, map.pdf(direction)),
        _ => 1.0,
    };
    scene.environment.radiance(direction) * weight
}

/// The weight of a sample drawn with density `a` that could have been drawn with density `b` too.
#[inline]
fn power_heuristic(a: f32, b: f32) -> f32 {
    // by the ratio, so that squares cannot overflow
    let ratio = b / a;
    1.0 / (1.0 + ratio * ratio)
}
