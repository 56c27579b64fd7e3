//! Physics of the path tracer: known radiances, independence of the number of threads, errors.

use std::f32::consts::PI;
use std::sync::atomic::{AtomicU32, Ordering};

use glam::{Mat4, Vec2, Vec3};
use loden::Error;
use loden::material::Material;
use loden::model::Lambert;
use loden::picture::Picture;
use loden::progress::{Progress, Silent};
use loden::render::{
    Body, Camera, DirectionalLight, Environment, EnvironmentMap, Instance, Lighting, Mesh, MeshData, Scene, Settings,
    Shape, Sphere, Studio, TextureMap, object, render, studio,
};

const CAMERA: Camera = Camera::pinhole(Vec3::new(0.0, 0.0, 4.0), Vec3::ZERO, 26.0);

const SPHERE: Sphere = Sphere { centre: Vec3::ZERO, radius: 1.0, axis: Vec3::Y };

fn scene<'a>(shapes: &[Shape], material: &'a dyn Material, environment: Environment) -> Scene<'a> {
    let body = |shape: &Shape| Body {
        shape: shape.clone(),
        material,
        material_name: "m".into(),
        texture: TextureMap::default(),
    };
    Scene {
        bodies: shapes.iter().map(body).collect(),
        lights: Vec::new(),
        environment,
        background: None,
        camera: CAMERA,
    }
}

fn settings(size: usize, spp: u32) -> Settings {
    Settings { width: size, height: size, spp, depth: 6, seed: 3 }
}

fn white() -> Lambert {
    Lambert { albedo: Vec3::ONE }
}

/// A sphere of flat triangles with the normals of the sphere.
fn faceted(n: usize) -> Shape {
    Shape::Mesh(Mesh::new(faceted_data(n)).unwrap().into())
}

fn faceted_data(n: usize) -> MeshData {
    let mut data = MeshData::default();
    for (i, j) in (0..=n).flat_map(|i| (0..=2 * n).map(move |j| (i, j))) {
        let (theta, phi) = (PI * i as f32 / n as f32, PI * j as f32 / n as f32);
        let p = Vec3::new(theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos());
        data.positions.push(p);
        data.normals.push(p);
        data.uvs.push(Vec2::new(j as f32, (n - i) as f32) / n as f32);
    }
    let at = |i: usize, j: usize| (i * (2 * n + 1) + j) as u32;
    for (i, j) in (0..n).flat_map(|i| (0..2 * n).map(move |j| (i, j))) {
        data.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
        data.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
    }
    data
}

/// The same surface in all senses: as it is, with its faces turned round, with its normals turned round, mirrored and
/// mirrored back by an instance, and mirrored by the mesh alone.
fn senses(data: &MeshData) -> Vec<Shape> {
    let mirror = Mat4::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    let mut mirrored = data.clone();
    mirrored.positions.iter_mut().for_each(|p| p.x = -p.x);
    mirrored.normals.iter_mut().for_each(|n| n.x = -n.x);
    let mut faces = data.clone();
    faces.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let mut normals = data.clone();
    normals.normals.iter_mut().for_each(|n| *n = -*n);
    let mesh = |data: &MeshData| Mesh::new(data.clone()).unwrap();
    let instance = Instance::new(mesh(&mirrored).into(), mirror).unwrap();
    let mut shapes: Vec<_> = [data.clone(), faces, normals].iter().map(|d| Shape::Mesh(mesh(d).into())).collect();
    shapes.push(Shape::Instance(Box::new(instance)));
    shapes
}

/// A wavy sheet over -1..1 in x and y, with its normals.
fn wave(n: usize) -> MeshData {
    let mut data = MeshData::default();
    for (i, j) in (0..=n).flat_map(|j| (0..=n).map(move |i| (i, j))) {
        let [x, y] = [i, j].map(|k| 2.0 * k as f32 / n as f32 - 1.0);
        data.positions.push(Vec3::new(x, y, 0.2 * (4.0 * x).sin() * (3.0 * y).cos()));
        let slope = [0.8 * (4.0 * x).cos() * (3.0 * y).cos(), -0.6 * (4.0 * x).sin() * (3.0 * y).sin()];
        data.normals.push(Vec3::new(-slope[0], -slope[1], 1.0).normalize());
        data.uvs.push(Vec2::new(x, y));
    }
    let at = |i: usize, j: usize| (j * (n + 1) + i) as u32;
    for (i, j) in (0..n).flat_map(|j| (0..n).map(move |i| (i, j))) {
        data.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
        data.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
    }
    data
}

fn mean(picture: &Picture) -> f32 {
    picture.rgb.iter().sum::<Vec3>().y / picture.rgb.len() as f32
}

#[test]
fn the_sense_of_faces_and_normals_does_not_change_a_picture() {
    let white = white();
    for data in [wave(12), faceted_data(12)] {
        let seen = |shape: &Shape| {
            let mut scene = scene(std::slice::from_ref(shape), &white, Environment::Dark);
            let direction = Vec3::new(0.3, 0.4, 1.0).normalize();
            scene.lights =
                vec![DirectionalLight { direction, irradiance: Vec3::splat(PI), radius_degrees: 0.0 }.into()];
            mean(&render(&scene, &Settings { depth: 2, ..settings(32, 16) }, &Silent).unwrap())
        };
        let means: Vec<f32> = senses(&data).iter().map(seen).collect();
        assert!(means[0] > 0.3, "{means:?}");
        assert!(means.iter().all(|m| (m / means[0] - 1.0).abs() < 0.004), "{means:?}");
    }
}

#[test]
fn closed_bodies_lit_from_outside_are_black_inside() {
    let white = white();
    for shape in senses(&faceted_data(9)).into_iter().chain([Shape::Sphere(SPHERE)]) {
        let mut scene = scene(&[shape], &white, Environment::Constant(Vec3::ONE));
        let direction = Vec3::new(1.0, 2.0, 3.0).normalize();
        scene.lights = vec![DirectionalLight { direction, irradiance: Vec3::ONE, radius_degrees: 5.0 }.into()];
        scene.camera = Camera::pinhole(Vec3::new(0.1, 0.2, 0.3), Vec3::ZERO, 100.0);
        let picture = render(&scene, &settings(24, 16), &Silent).unwrap();
        assert!(picture.rgb.iter().all(|c| *c == Vec3::ZERO));
    }
}

#[test]
fn pictures_do_not_depend_on_the_unit_of_length() {
    let white = Lambert { albedo: Vec3::splat(0.7) };
    let square = |y: f32, half: f32| MeshData {
        positions: [[-half, half], [half, half], [half, -half], [-half, -half]].map(|[x, z]| Vec3::new(x, y, z)).into(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..MeshData::default()
    };
    let at = |scale: f32| {
        let scaled = |mut data: MeshData| {
            data.positions.iter_mut().for_each(|p| *p *= scale);
            Shape::Mesh(Mesh::new(data).unwrap().into())
        };
        let instance = Instance::new(Mesh::new(faceted_data(16)).unwrap().into(), Mat4::from_scale(Vec3::splat(scale)));
        let sphere = Shape::Sphere(Sphere { centre: Vec3::new(1.5, 0.0, -1.0) * scale, radius: scale, axis: Vec3::Y });
        let shapes = [scaled(square(-1.0, 4.0)), Shape::Instance(Box::new(instance.unwrap())), sphere];
        let mut scene = scene(&shapes, &white, Environment::Constant(Vec3::ONE));
        scene.camera = Camera::pinhole(Vec3::new(0.0, 1.2, 5.0) * scale, Vec3::ZERO, 40.0);
        mean(&render(&scene, &settings(24, 64), &Silent).unwrap())
    };
    let expected = at(1.0);
    for scale in [1e-8, 1e-6, 1e-4, 1e-2, 1e3, 1e6] {
        let found = at(scale);
        assert!((found / expected - 1.0).abs() < 0.002, "{scale}: {found}, not {expected}");
    }
}

#[test]
fn a_white_sphere_in_a_white_sky_is_invisible() {
    let white = white();
    let sky = Environment::Constant(Vec3::ONE);
    let picture = render(&scene(&[Shape::Sphere(SPHERE)], &white, sky.clone()), &settings(24, 4), &Silent).unwrap();
    // a convex body reflects each path once with weight 1, so there is no noise
    assert!(picture.rgb.iter().all(|c| (*c - Vec3::ONE).abs().max_element() < 1e-4));
    // with interpolated normals, a few paths graze their own facets
    let settings = Settings { depth: 64, ..settings(24, 16) };
    let picture = render(&scene(&[faceted(48)], &white, sky), &settings, &Silent).unwrap();
    let mean = picture.rgb.iter().sum::<Vec3>() / picture.rgb.len() as f32;
    assert!((mean - Vec3::ONE).abs().max_element() < 0.002, "{mean}");
}

#[test]
fn a_white_sphere_in_a_white_picture_is_invisible_on_average() {
    let white = white();
    let map = EnvironmentMap::new(Picture::filled(16, 8, Vec3::ONE), 0.0).unwrap();
    let scene = scene(&[Shape::Sphere(SPHERE)], &white, Environment::Map(Box::new(map)));
    let picture = render(&scene, &settings(24, 256), &Silent).unwrap();
    let values: Vec<f64> = picture.rgb.iter().map(|c| f64::from(c.x)).collect();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64;
    let error = (variance / values.len() as f64).sqrt();
    assert!((mean - 1.0).abs() < 4.0 * error && error < 1e-3, "{mean} +- {error}");
}

#[test]
fn a_directional_light_gives_the_cosine() {
    let material = Lambert { albedo: Vec3::new(0.8, 0.4, 0.2) };
    let towards = Vec3::new(1.0, 2.0, 2.0) / 3.0;
    for shape in [Shape::Sphere(SPHERE), faceted(96)] {
        let mut scene = scene(&[shape], &material, Environment::Dark);
        let light = DirectionalLight { direction: towards, irradiance: Vec3::splat(2.0), radius_degrees: 0.0 };
        scene.lights.push(light.into());
        let size = 64;
        let picture = render(&scene, &settings(size, 16), &Silent).unwrap();
        let pixel = 2.0 * (13f32.to_radians()).tan() / size as f32;
        let mut checked = 0;
        for (x, y) in (0..size * size).map(|i| (i % size, i / size)) {
            let at = |x: usize| x as f32 + 0.5 - 0.5 * size as f32;
            let direction = Vec3::new(at(x) * pixel, -at(y) * pixel, -1.0).normalize();
            let middle = -CAMERA.position.dot(direction);
            let beside = (CAMERA.position + direction * middle).length();
            let found = picture.at(x, y);
            if beside > 1.1 {
                assert_eq!(found, Vec3::ZERO);
            } else if beside < 0.9 {
                let normal = CAMERA.position + direction * (middle - (1.0 - beside * beside).sqrt());
                let cosine = normal.dot(towards);
                let expected = material.albedo * cosine.max(0.0) * 2.0 / PI;
                // the pixel filter blurs the kink of the cosine at the shadow edge
                let slack = if cosine.abs() < 0.12 { 0.02 } else { 0.004 };
                assert!((found - expected).abs().max_element() < slack, "({x}, {y}): {found}, not {expected}");
                checked += 1;
            }
        }
        assert!(checked > 1000);
    }
}

#[test]
fn threads_do_not_change_a_bit_and_seeds_do() {
    let map = EnvironmentMap::new(Picture { width: 2, height: 1, rgb: vec![Vec3::ONE, Vec3::X] }, 0.0).unwrap();
    let teapot = object::load("teapot").unwrap();
    let grey = Lambert { albedo: Vec3::splat(0.5) };
    for lighting in [Lighting::default(), Lighting::Environment(Box::new(map))] {
        let with = |threads: usize, seed: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let view = Studio {
                object: &teapot,
                material: &grey,
                material_name: "grey",
                texture: TextureMap::default(),
                lighting: lighting.clone(),
            };
            let settings = Settings { width: 50, height: 35, spp: 4, depth: 6, seed };
            pool.install(|| studio(&view, &settings, &Silent)).unwrap()
        };
        assert_eq!(with(1, 1), with(2, 1));
        assert_ne!(with(2, 1), with(2, 2));
    }
}

/// Reflects only light along its own x axis.
struct Grain;

impl Material for Grain {
    fn apparent(&self, _uv: Vec2, wi: Vec3, _wo: Vec3) -> Vec3 {
        Vec3::splat(wi.x.max(0.0) * f32::from(wi.y.abs() < 0.1))
    }
}

#[test]
fn a_rotated_texture_takes_its_grain_along() {
    // a square in the plane z = 0, seen from the front; u points right, v up
    let data = MeshData {
        positions: [[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]].map(|[x, y]| Vec3::new(x, y, 0.0)).into(),
        normals: Vec::new(),
        tangents: Vec::new(),
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    };
    let shape = Shape::Mesh(Mesh::new(data).unwrap().into());
    let seen = |rotation_degrees: f32, azimuth_degrees: f32| {
        let mut scene = scene(std::slice::from_ref(&shape), &Grain, Environment::Dark);
        scene.bodies[0].texture.rotation_degrees = rotation_degrees;
        let (s, c) = azimuth_degrees.to_radians().sin_cos();
        let direction = Vec3::new(c, s, 1.0).normalize();
        let light = DirectionalLight { direction, irradiance: Vec3::splat(PI), radius_degrees: 0.0 };
        scene.lights.push(light.into());
        render(&scene, &settings(4, 1), &Silent).unwrap().at(1, 1).x
    };
    for rotation in [0.0, 30.0, 90.0, 200.0] {
        assert!((seen(rotation, rotation) - 0.5f32.sqrt()).abs() < 1e-4);
        for other in [20.0, 90.0, 180.0] {
            assert_eq!(seen(rotation, rotation + other), 0.0);
        }
    }
}

#[test]
fn the_back_of_a_sheet_is_lit_from_its_own_side() {
    let data = MeshData {
        positions: vec![Vec3::new(-3.0, -3.0, 0.0), Vec3::new(3.0, -3.0, 0.0), Vec3::new(0.0, 5.0, 0.0)],
        triangles: vec![[0, 2, 1]],
        ..MeshData::default()
    };
    let white = white();
    let mut scene = scene(&[Shape::Mesh(Mesh::new(data).unwrap().into())], &white, Environment::Dark);
    for (z, expected) in [(1.0, 1.0), (-1.0, 0.0)] {
        let direction = Vec3::new(0.0, 0.0, z);
        let light = DirectionalLight { direction, irradiance: Vec3::splat(PI), radius_degrees: 0.0 };
        scene.lights = vec![light.into()];
        let picture = render(&scene, &settings(4, 1), &Silent).unwrap();
        assert!((picture.at(1, 1).x - expected).abs() < 1e-5);
    }
}

/// NaN at one point.
struct Broken;

impl Material for Broken {
    fn apparent(&self, uv: Vec2, wi: Vec3, _wo: Vec3) -> Vec3 {
        if uv.y > 0.7 { Vec3::new(0.0, f32::NAN, 0.0) } else { Vec3::splat(wi.z) }
    }
}

#[test]
fn a_material_that_is_not_finite_is_named() {
    let mut scene = scene(&[Shape::Sphere(SPHERE)], &Broken, Environment::Constant(Vec3::ONE));
    scene.bodies[0].material_name = "moth-eaten".into();
    let error = render(&scene, &settings(16, 1), &Silent).unwrap_err().to_string();
    assert!(error.contains("material moth-eaten") && error.contains("NaN") && error.contains("uv"), "{error}");
}

/// Asks to stop after a few tiles.
struct Impatient(AtomicU32);

impl Progress for Impatient {
    fn advance(&self, steps: u64) {
        self.0.fetch_add(steps as u32, Ordering::Relaxed);
    }
    fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed) > 2
    }
}

#[test]
fn rendering_can_be_cancelled() {
    let white = white();
    let scene = scene(&[Shape::Sphere(SPHERE)], &white, Environment::Dark);
    let progress = Impatient(AtomicU32::new(0));
    assert!(matches!(render(&scene, &settings(512, 1), &progress), Err(Error::Cancelled)));
    assert!(progress.0.load(Ordering::Relaxed) < 100);
}

#[test]
fn impossible_settings_are_named() {
    let white = white();
    let good = Settings::default();
    let scene = scene(&[Shape::Sphere(SPHERE)], &white, Environment::Dark);
    for (settings, name) in [
        (Settings { width: 0, ..good }, "width"),
        (Settings { height: 1 << 20, ..good }, "height"),
        (Settings { width: 60_000, height: 60_000, ..good }, "pixels"),
        (Settings { spp: 0, ..good }, "spp"),
        (Settings { depth: 0, ..good }, "depth"),
    ] {
        let error = render(&scene, &settings, &Silent).unwrap_err().to_string();
        assert!(error.starts_with(name), "{error}");
    }
    let sphere = object::load("sphere").unwrap();
    let view = |theta_degrees: f32, scale: f32| Studio {
        object: &sphere,
        material: &white,
        material_name: "white",
        texture: TextureMap { scale, ..TextureMap::default() },
        lighting: Lighting::Key { theta_degrees, phi_degrees: 0.0 },
    };
    for (view, name) in [(view(91.0, 1.0), "light"), (view(f32::NAN, 1.0), "light"), (view(30.0, 0.0), "uv-scale")] {
        let error = studio(&view, &good, &Silent).unwrap_err().to_string();
        assert!(error.starts_with(name), "{error}");
    }
}
