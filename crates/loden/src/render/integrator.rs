//! Path tracing.

use std::f32::consts::PI;
use std::ops::Range;

use glam::{Vec2, Vec3};

use super::Ray;
use super::bvh::{Bundle, RAYS, Row, lanes};
use super::environment::Environment;
use super::filter::Pixel;
use super::light::Arriving;
use super::sampler::Sampler;
use super::scene::{Body, Scene};
use super::surface::Surfaces;
use super::texture::Shading;
use super::tracer::{Met, NO_LIGHT, Tracer, What};
use crate::Error;
use crate::material::{Bounce, Material, Seen};
use crate::simd::many::Many;

/// From which segment on Russian roulette may end a path.
const ROULETTE_FROM: u32 = 4;

/// Shadow rays end this much before a light, so that what the light lies on does not shadow it.
const SHORTER: f32 = 1.0 - 1e-4;

/// A material's value that is not finite, and where.
#[derive(Debug, Clone)]
pub(super) struct Fault {
    material: String,
    uv: Vec2,
    wi: Vec3,
    wo: Vec3,
    value: Vec3,
}

impl From<Box<Fault>> for Error {
    fn from(fault: Box<Fault>) -> Self {
        let Fault { material, uv, wi, wo, value } = *fault;
        let problem = format!("its value is {value} at uv {uv}, wi {wi}, wo {wo} (local frame)");
        Self::parameter(format!("material {material}"), problem)
    }
}

/// The most points that a material is asked for at a time.
const ASKED: usize = 64;

/// Traces paths, many at a time.
///
/// # Model
/// The rendering equation is estimated by paths of at most `depth` segments, camera ray included. At every
/// surface each light is connected to, and an environment map; area lights and the map are met by the direction
/// the material draws as well, and both are combined by multiple importance sampling (power heuristic). A constant
/// sky is met by the material's directions alone. From the fourth segment on, paths end with a probability given by
/// their throughput, without bias.
///
/// All paths take a step together: sixteen rays are traced at once, from the second segment on rays of similar directions. What
/// a path finds does not depend on the others.
///
/// # Limits
/// Directional lights, points and spots are met by connection only, so a perfect mirror does not show them. Negative material
/// values count as 0.
///
/// # References
/// kajiya1986, veach1997 sections 9.2 and 10.2; laine2013 for steps taken together
pub(super) struct Paths<'a> {
    tracer: &'a Tracer<'a>,
    depth: u32,
    paths: Vec<Path>,
    /// Memory for those that go on.
    kept: Vec<Path>,
    /// In which order rays are traced.
    order: Vec<u16>,
    points: Vec<Point<'a>>,
    shadows: Vec<Shadow>,
    /// Those that nothing is in the way of.
    lit: Vec<Shadow>,
    /// Two numbers for each point.
    random: Vec<Vec2>,
}

/// The most paths at a time; 16 bits count them.
pub(super) const PATHS: usize = 4096;

/// Where paths begin.
pub(super) trait Camera {
    /// The rays of at most [`RAYS`] places among those of this time, and the random numbers that are left of them.
    fn start(&self, places: Range<usize>, rays: &mut Many<Ray, 6>, samplers: &mut Many<Sampler, 3>);

    /// Where the ray is within its pixel.
    fn pixel(&self, place: usize) -> Pixel<'_>;
}

/// A path on its way.
struct Path {
    ray: Ray,
    throughput: Vec3,
    /// The density with which the material drew the ray; none for the camera's.
    drawn: Option<f32>,
    sampler: Sampler,
    /// Its place among those that began with it.
    place: u32,
}

/// A connection from a point towards a light.
#[derive(Clone, Copy)]
struct Shadow {
    point: u32,
    direction: Vec3,
    /// The same in the frame of the point.
    wi: Vec3,
    distance: f32,
    /// Irradiance, or what else the material's value is multiplied by.
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
        self.paths.clear();
        let (mut rays, mut samplers) = (Many::ZERO, Many::ZERO);
        for first in (0..sums.len()).step_by(RAYS) {
            let places = first..sums.len().min(first + RAYS);
            camera.start(places.clone(), &mut rays, &mut samplers);
            self.paths.extend(places.map(|place| Path {
                ray: rays.get(place - first),
                throughput: Vec3::ONE,
                drawn: None,
                sampler: samplers.get(place - first),
                place: place as u32,
            }));
        }
        for segment in 1..=self.depth {
            self.sort(segment);
            self.meet(segment, camera, sums);
            if self.points.is_empty() {
                break;
            }
            self.connect(sums)?;
            self.scatter(segment)?;
        }
        Ok(())
    }

    /// Puts rays of similar directions together, otherwise in the order of their pixels; camera rays are so.
    #[inline(always)]
    fn sort(&mut self, segment: u32) {
        let Self { paths, order, .. } = self;
        order.clear();
        order.extend(0..paths.len() as u16);
        if segment == 1 {
            return;
        }
        let key = |path: &Path| usize::from(direction_key(path.ray.direction));
        let mut places = [0; 65];
        paths.iter().for_each(|path| places[key(path) + 1] += 1);
        (1..places.len()).for_each(|k| places[k] += places[k - 1]);
        for (index, path) in (0..).zip(paths.iter()) {
            let place = &mut places[key(path)];
            order[*place] = index;
            *place += 1;
        }
    }

    /// Follows all rays to the points that they meet; paths that leave the scene or meet a light end.
    #[inline(always)]
    fn meet(&mut self, segment: u32, camera: &impl Camera, sums: &mut [Vec3]) {
        let Self { tracer, depth, paths, order, points, .. } = self;
        let scene = tracer.scene;
        points.clear();
        let (mut bundle, mut met, mut surfaces) = (Bundle::EMPTY, Met::nothing(), Surfaces::new());
        for indices in order.chunks(RAYS) {
            bundle.t_max = Row::ZERO;
            for (lane, &index) in indices.iter().enumerate() {
                bundle.set(lane, &paths[index as usize].ray, f32::INFINITY);
            }
            tracer.closest(&mut bundle, &mut met);
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
            if segment == *depth || bodies == 0 {
                continue;
            }
            surfaces.find(scene, &bundle, &met, bodies, |lane| paths[indices[lane] as usize].sampler.next_1d());
            for lane in lanes(bodies) {
                let Some(body) = met.body(scene, lane) else { continue };
                let Path { sampler, place, .. } = &mut paths[indices[lane] as usize];
                let mut shading = surfaces.shadings.get(lane);
                let texels = body.material.texels();
                if !body.texture.wrap(&mut shading, texels) {
                    continue;
                }
                let seen = |uv: Vec2| body.material.seen(uv, shading.wo);
                let others = if segment == 1 && body.texture.samples > 1 {
                    let (pixel, hit) = (camera.pixel(*place as usize), surfaces.hits.get(lane));
                    let meeting = met.meeting(&body.shape, &bundle, lane);
                    let uvs = pixel.others(body, (&hit, &meeting), texels, || sampler.next_2d());
                    uvs.into_iter().map(seen).collect()
                } else {
                    Vec::new()
                };
                let path = indices[lane];
                points.push(Point { body, path, seen: seen(shading.uv), others, shading, lit: Vec3::ZERO });
            }
        }
    }

    /// Adds the light of all lights at all points.
    #[inline(always)]
    fn connect(&mut self, sums: &mut [Vec3]) -> Result<(), Box<Fault>> {
        let scene = self.tracer.scene;
        for (index, light) in scene.lights.iter().enumerate() {
            self.connect_to(index, |at, sampler| {
                let Arriving { direction, distance, irradiance, pdf } = light.arriving(at, || sampler.next_2d())?;
                Some((direction, distance * SHORTER, irradiance, pdf))
            })?;
        }
        self.add_lit(sums);
        if let Environment::Map(map) = &scene.environment {
            self.connect_to(NO_LIGHT, |_, sampler| {
                let (direction, pdf) = map.sample(sampler.next_2d())?;
                (pdf > 0.0).then(|| (direction, f32::INFINITY, map.radiance(direction) / pdf, pdf))
            })?;
            self.add_lit(sums);
        }
        Ok(())
    }

    #[inline(always)]
    fn add_lit(&mut self, sums: &mut [Vec3]) {
        for point in &mut self.points {
            let path = &self.paths[point.path as usize];
            sums[path.place as usize] += path.throughput * std::mem::take(&mut point.lit);
        }
    }

    /// Adds what arrives at all points from the directions that `draw` gives for their places: direction, distance,
    /// irradiance and density. `light` throws no shadow.
    #[inline(always)]
    fn connect_to(
        &mut self,
        light: usize,
        draw: impl Fn(Vec3, &mut Sampler) -> Option<(Vec3, f32, Vec3, f32)>,
    ) -> Result<(), Box<Fault>> {
        let Self { tracer, paths, points, shadows, lit, .. } = self;
        shadows.clear();
        lit.clear();
        for (index, point) in points.iter().enumerate() {
            let sampler = &mut paths[point.path as usize].sampler;
            let Some((direction, distance, irradiance, pdf)) = draw(point.shading.origin, sampler) else { continue };
            let wi = point.shading.frame.local(direction);
            if wi.z > 0.0 {
                shadows.push(Shadow { point: index as u32, direction, wi, distance, irradiance, pdf });
            }
        }
        let mut bundle = Bundle::EMPTY;
        for shadows in shadows.chunks(RAYS) {
            bundle.t_max = Row::ZERO;
            for (lane, shadow) in shadows.iter().enumerate() {
                let origin = points[shadow.point as usize].shading.origin;
                bundle.set(lane, &Ray { origin, direction: shadow.direction }, shadow.distance);
            }
            let occluded = tracer.occluded(&mut bundle, light);
            lit.extend(shadows.iter().enumerate().filter(|(lane, _)| occluded >> lane & 1 == 0).map(|(_, s)| *s));
        }
        let same = |points: &[Point], a: &Shadow, b: &Shadow| {
            is_same(points[a.point as usize].body.material, points[b.point as usize].body.material)
        };
        let mut rest = &lit[..];
        while let Some(first) = rest.first() {
            let count = rest.iter().take(ASKED).take_while(|shadow| same(points, first, shadow)).count();
            let (run, others) = rest.split_at(count);
            rest = others;
            let mut values = [Vec3::ZERO; ASKED];
            apparent(points, run, &mut values)?;
            for (shadow, value) in run.iter().zip(values) {
                let point = &mut points[shadow.point as usize];
                let weight = if shadow.pdf > 0.0 {
                    power_heuristic(shadow.pdf, point.body.material.pdf_seen(&point.seen, shadow.wi))
                } else {
                    1.0
                };
                point.lit += value * shadow.irradiance * (weight / PI);
            }
        }
        Ok(())
    }

    /// Draws directions in which paths go on.
    #[inline(always)]
    fn scatter(&mut self, segment: u32) -> Result<(), Box<Fault>> {
        let Self { paths, kept, points, random, .. } = self;
        kept.clear();
        random.clear();
        let (mut samplers, mut numbers) = (Many::<Sampler, 3>::ZERO, Many::<Vec2, 2>::ZERO);
        for points in points.chunks(RAYS) {
            for (lane, point) in points.iter().enumerate() {
                samplers.set(lane, paths[point.path as usize].sampler);
            }
            for lane in 0..RAYS {
                let mut sampler = samplers.get(lane);
                numbers.set(lane, sampler.next_2d());
                samplers.set(lane, sampler);
            }
            for (lane, point) in points.iter().enumerate() {
                paths[point.path as usize].sampler = samplers.get(lane);
                random.push(numbers.get(lane));
            }
        }
        let mut random = &random[..];
        for run in points.chunk_by(|a, b| is_same(a.body.material, b.body.material)).flat_map(|run| run.chunks(ASKED)) {
            let mut seen = [&run[0].seen; ASKED];
            seen.iter_mut().zip(run).for_each(|(seen, point)| *seen = &point.seen);
            let mut bounces = [Bounce::NONE; ASKED];
            let (numbers, left) = random.split_at(run.len());
            random = left;
            run[0].body.material.scatter_many(&seen[..run.len()], numbers, &mut bounces[..run.len()]);
            for (point, bounce) in run.iter().zip(&bounces).filter(|(_, bounce)| bounce.pdf > 0.0) {
                let Path { throughput, place, mut sampler, .. } = paths[point.path as usize];
                let value = point.mean(bounce.wi, bounce.value)?;
                let mut throughput = throughput * value / (PI * bounce.pdf);
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
                let direction = point.shading.frame.world(bounce.wi).normalize();
                let ray = Ray { origin: point.shading.origin, direction };
                kept.push(Path { ray, throughput, drawn: Some(bounce.pdf), sampler, place });
            }
        }
        std::mem::swap(paths, kept);
        Ok(())
    }
}

/// Whether two references are of one material; never of materials of different types, which may share an address if they
/// have no size.
#[allow(
    ambiguous_wide_pointer_comparisons,
    reason = "if one type has two tables of functions, runs are shorter, no more"
)]
fn is_same(a: &dyn Material, b: &dyn Material) -> bool {
    std::ptr::eq(a, b)
}

/// The apparent values, checked, of at most [`ASKED`] connections, all with points of one material.
#[inline(always)]
fn apparent(points: &[Point], shadows: &[Shadow], values: &mut [Vec3; ASKED]) -> Result<(), Box<Fault>> {
    let first = &points[shadows[0].point as usize];
    let (mut seen, mut wi) = ([&first.seen; ASKED], [Vec3::Z; ASKED]);
    for (lane, shadow) in shadows.iter().enumerate() {
        (seen[lane], wi[lane]) = (&points[shadow.point as usize].seen, shadow.wi);
    }
    let count = shadows.len();
    first.body.material.apparent_many(&seen[..count], &wi[..count], &mut values[..count]);
    for (value, shadow) in values.iter_mut().zip(shadows) {
        *value = points[shadow.point as usize].mean(shadow.wi, *value)?;
    }
    Ok(())
}

/// A number that similar directions share: the cell of an octahedral map.
#[inline]
fn direction_key(d: Vec3) -> u8 {
    let d = d / (d.x.abs() + d.y.abs() + d.z.abs());
    let fold = |a: f32, b: f32| if d.z < 0.0 { (1.0 - b.abs()).copysign(a) } else { a };
    let cell = |x: f32| ((x * 4.0 + 4.0) as i32).clamp(0, 7) as u8;
    let (x, y) = (cell(fold(d.x, d.y)), cell(fold(d.y, d.x)));
    // row by row, back and forth
    y << 3 | if y & 1 == 0 { x } else { 7 - x }
}

/// What the environment adds to a path that left the scene.
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

/// A surface point on a path.
struct Point<'a> {
    body: &'a Body<'a>,
    path: u16,
    shading: Shading,
    seen: Seen,
    /// Of the pixel, by which the material's value is averaged.
    others: Vec<Seen>,
    /// Light that was found to be reflected.
    lit: Vec3,
}

impl Point<'_> {
    /// The material's apparent value, checked, averaged over the pixel, from that at the point itself.
    #[inline(always)]
    fn mean(&self, wi: Vec3, value: Vec3) -> Result<Vec3, Box<Fault>> {
        let mut sum = self.checked(&self.seen, wi, value)?;
        for seen in &self.others {
            sum += self.checked(seen, wi, self.body.material.apparent_seen(seen, wi))?;
        }
        Ok(if self.others.is_empty() { sum } else { sum / (1 + self.others.len()) as f32 })
    }

    #[inline(always)]
    fn checked(&self, seen: &Seen, wi: Vec3, value: Vec3) -> Result<Vec3, Box<Fault>> {
        if value.is_finite() {
            return Ok(value.max(Vec3::ZERO));
        }
        let Seen { uv, wo, .. } = *seen;
        Err(Box::new(Fault { material: self.body.material_name.clone(), uv, wi, wo, value }))
    }
}
