//! Path tracing.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::Ray;
use super::bvh::{Bundle, RAYS, Row};
use super::environment::Environment;
use super::filter::Pixel;
use super::light::Arriving;
use super::sampler::Sampler;
use super::scene::{Body, Scene};
use super::texture::Shading;
use super::tracer::{Met, NO_LIGHT, Tracer, What};
use crate::Error;
use crate::material::{Sample, Seen};

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
}

/// The most paths at a time; 16 bits count them.
pub(super) const PATHS: usize = 4096;

/// Where paths begin.
pub(super) trait Camera {
    /// The ray of a place among those of this time, and the random numbers that are left of it.
    fn start(&self, place: usize) -> (Ray, Sampler);

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

// the steps are inlined into their caller, which is compiled for AVX2, too
impl<'a> Paths<'a> {
    pub(super) fn new(tracer: &'a Tracer<'a>, depth: u32) -> Self {
        let (paths, kept) = (Vec::with_capacity(PATHS), Vec::with_capacity(PATHS));
        Self { tracer, depth, paths, kept, order: Vec::new(), points: Vec::with_capacity(PATHS), shadows: Vec::new() }
    }

    /// The radiance that arrives along each of at most [`PATHS`] camera rays.
    #[inline(always)]
    pub(super) fn radiance(&mut self, camera: &impl Camera, sums: &mut [Vec3]) -> Result<(), Box<Fault>> {
        sums.fill(Vec3::ZERO);
        self.paths.clear();
        for place in 0..sums.len() {
            let (ray, sampler) = camera.start(place);
            self.paths.push(Path { ray, throughput: Vec3::ONE, drawn: None, sampler, place: place as u32 });
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
        let (mut bundle, mut met) = (Bundle::EMPTY, Met::nothing());
        for indices in order.chunks(RAYS) {
            bundle.t_max = Row::ZERO;
            for (lane, &index) in indices.iter().enumerate() {
                bundle.set(lane, &paths[index as usize].ray, f32::INFINITY);
            }
            tracer.closest(&mut bundle, &mut met);
            for (lane, &index) in indices.iter().enumerate() {
                let Path { ray, throughput, drawn, sampler, place } = &mut paths[index as usize];
                let sum = &mut sums[*place as usize];
                let body = match met.what[lane] {
                    What::Body(body) => &scene.bodies[body as usize],
                    What::Light(light) => {
                        let (_, light) = tracer.areas[light as usize];
                        let (radiance, pdf) = light.seen(ray, bundle.t_max.0[lane]);
                        *sum += *throughput * radiance * drawn.map_or(1.0, |drawn| power_heuristic(drawn, pdf));
                        continue;
                    }
                    What::Nothing => {
                        *sum += *throughput * escaped(scene, ray.direction, *drawn);
                        continue;
                    }
                };
                if segment == *depth {
                    continue;
                }
                let meeting = met.meeting(&body.shape, &bundle, lane);
                let hit = body.shape.surface(ray, &meeting);
                let texels = body.material.texels();
                let shading = body.texture.shading(&hit, -ray.direction, texels, || sampler.next_1d());
                if !shading.covered {
                    continue;
                }
                let seen = |uv: Vec2| body.material.seen(uv, shading.wo);
                let others = if segment == 1 && body.texture.samples > 1 {
                    let pixel = camera.pixel(*place as usize);
                    let uvs = pixel.others(body, (&hit, &meeting), texels, || sampler.next_2d());
                    uvs.into_iter().map(seen).collect()
                } else {
                    Vec::new()
                };
                points.push(Point { body, path: index, seen: seen(shading.uv), others, shading, lit: Vec3::ZERO });
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
        let Self { tracer, paths, points, shadows, .. } = self;
        shadows.clear();
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
            for (lane, shadow) in shadows.iter().enumerate() {
                if occluded >> lane & 1 != 0 {
                    continue;
                }
                let point = &mut points[shadow.point as usize];
                let value = point.apparent(shadow.wi)? * shadow.irradiance * (1.0 / PI);
                let weight = if shadow.pdf > 0.0 {
                    power_heuristic(shadow.pdf, point.body.material.pdf_seen(&point.seen, shadow.wi))
                } else {
                    1.0
                };
                point.lit += value * weight;
            }
        }
        Ok(())
    }

    /// Draws directions in which paths go on.
    #[inline(always)]
    fn scatter(&mut self, segment: u32) -> Result<(), Box<Fault>> {
        let mut kept = std::mem::take(&mut self.kept);
        kept.clear();
        for point in &self.points {
            let Path { throughput, sampler, place, .. } = &mut self.paths[point.path as usize];
            let Some((sample, value)) = point.scatter(sampler.next_2d())? else { continue };
            let mut throughput = *throughput * value / (PI * sample.pdf);
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
            let direction = point.shading.frame.world(sample.wi).normalize();
            let ray = Ray { origin: point.shading.origin, direction };
            kept.push(Path { ray, throughput, drawn: Some(sample.pdf), sampler: *sampler, place: *place });
        }
        self.kept = std::mem::replace(&mut self.paths, kept);
        Ok(())
    }
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
    /// The material's apparent value, checked.
    #[inline]
    fn apparent(&self, wi: Vec3) -> Result<Vec3, Box<Fault>> {
        let mut value = self.apparent_at(&self.seen, wi)?;
        if !self.others.is_empty() {
            for seen in &self.others {
                value += self.apparent_at(seen, wi)?;
            }
            value /= (1 + self.others.len()) as f32;
        }
        Ok(value)
    }

    /// A direction that the material draws, and its apparent value there, checked.
    #[inline]
    fn scatter(&self, random: Vec2) -> Result<Option<(Sample, Vec3)>, Box<Fault>> {
        let material = self.body.material;
        if self.others.is_empty() {
            let drawn = material.scatter_seen(&self.seen, random).filter(|(sample, _)| sample.pdf > 0.0);
            return drawn.map(|(sample, v)| Ok((sample, self.checked(&self.seen, sample.wi, v)?))).transpose();
        }
        let drawn = material.sample_seen(&self.seen, random).filter(|sample| sample.pdf > 0.0);
        drawn.map(|sample| Ok((sample, self.apparent(sample.wi)?))).transpose()
    }

    #[inline]
    fn apparent_at(&self, seen: &Seen, wi: Vec3) -> Result<Vec3, Box<Fault>> {
        self.checked(seen, wi, self.body.material.apparent_seen(seen, wi))
    }

    #[inline]
    fn checked(&self, seen: &Seen, wi: Vec3, value: Vec3) -> Result<Vec3, Box<Fault>> {
        if value.is_finite() {
            return Ok(value.max(Vec3::ZERO));
        }
        let Seen { uv, wo, .. } = *seen;
        Err(Box::new(Fault { material: self.body.material_name.clone(), uv, wi, wo, value }))
    }
}
