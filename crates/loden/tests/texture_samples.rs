//! Several points of a texture for one camera ray: less noise, the same picture.

use glam::{Mat4, Quat, Vec2, Vec3};
use loden::material::{Material, Sample};
use loden::picture::Picture;
use loden::progress::Silent;
use loden::render::{
    Body, Camera, DirectionalLight, Environment, Instance, Mapping, Mesh, MeshData, Scene, Settings, Shape, Sphere,
    TextureMap, Wrap, render,
};

const SIDE: usize = 32;

/// Random black and white texels in equal numbers.
struct Grain;

impl Material for Grain {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        let cell = ((uv - uv.floor()) * SIDE as f32).as_uvec2();
        let hash = (cell.x + 64 * cell.y).wrapping_mul(0x9e37_79b9);
        let white = (hash ^ (hash >> 15)).wrapping_mul(0x85eb_ca6b) >> 31;
        if wi.z > 0.0 && wo.z > 0.0 { Vec3::splat(white as f32 * wi.z) } else { Vec3::ZERO }
    }

    fn texels(&self) -> Option<[usize; 2]> {
        Some([SIDE, SIDE])
    }

    fn sample(&self, _uv: Vec2, _wo: Vec3, _random: Vec2) -> Option<Sample> {
        None
    }
}

/// A square from -1 to 1 on the floor.
fn floor() -> Mesh {
    let uvs = vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    let positions = uvs.iter().map(|uv| Vec3::new(2.0 * uv.x - 1.0, 0.0, 1.0 - 2.0 * uv.y)).collect();
    Mesh::new(MeshData { positions, uvs, triangles: vec![[0, 1, 2], [0, 2, 3]], ..MeshData::default() }).unwrap()
}

fn shapes() -> [(&'static str, Shape); 3] {
    let turn = Mat4::from_rotation_translation(Quat::from_rotation_y(0.7), Vec3::new(0.1, 0.2, 0.0));
    [
        ("mesh", Shape::Mesh(floor().into())),
        ("instance", Shape::Instance(Box::new(Instance::new(floor().into(), turn).unwrap()))),
        ("sphere", Shape::Sphere(Sphere { centre: Vec3::ZERO, radius: 1.0, axis: Vec3::Y })),
    ]
}

fn draw(shape: &Shape, texture: TextureMap, spp: u32, seed: u64) -> Picture {
    let body = Body { shape: shape.clone(), material: &Grain, material_name: "grain".into(), texture };
    let light =
        DirectionalLight { direction: Vec3::new(0.0, 0.8, 0.6), irradiance: Vec3::ONE * 3.0, radius_degrees: 0.0 };
    let scene = Scene {
        bodies: vec![body],
        lights: vec![light.into()],
        environment: Environment::Dark,
        background: None,
        camera: Camera::pinhole(Vec3::new(0.3, 1.2, 3.0), Vec3::ZERO, 36.0),
    };
    render(&scene, &Settings { width: 48, height: 48, spp, depth: 2, seed }, &Silent).unwrap()
}

fn squared_error(a: &Picture, b: &Picture) -> f32 {
    a.rgb.iter().zip(&b.rgb).map(|(a, b)| (a.x - b.x).powi(2)).sum::<f32>() / a.rgb.len() as f32
}

#[test]
fn more_points_make_less_noise_and_the_same_picture() {
    let plane = Mapping::Plane { origin: Vec3::ZERO, u: 2.0 * Vec3::X, v: -2.0 * Vec3::Z };
    for (name, shape) in shapes() {
        for mapping in [Mapping::Surface, plane] {
            let texture = TextureMap { scale: 6.0, rotation_degrees: 20.0, mapping, ..TextureMap::default() };
            let filtered = TextureMap { samples: 16, ..texture };
            let reference = draw(&shape, texture, 1024, 1);
            let error = |texture, spp| squared_error(&draw(&shape, texture, spp, 2), &reference);
            let (without, with) = (error(texture, 4), error(filtered, 4));
            assert!(with < 0.4 * without, "{name} {mapping:?}: {with} instead of {without}");
            let (without, with) = (error(texture, 256), error(filtered, 256));
            assert!(with < without, "{name} {mapping:?}: {with} instead of {without}: another picture");
        }
    }
}

#[test]
fn where_nothing_can_be_averaged_nothing_changes() {
    let (_, shape) = &shapes()[0];
    for texture in [
        TextureMap { scale: 0.1, ..TextureMap::default() },
        TextureMap { scale: 6.0, wrap: Wrap::Mirror, ..TextureMap::default() },
        TextureMap { mapping: Mapping::Triplanar { origin: Vec3::ZERO, size: 0.3 }, ..TextureMap::default() },
    ] {
        assert_eq!(draw(shape, TextureMap { samples: 16, ..texture }, 4, 1), draw(shape, texture, 4, 1), "{texture:?}");
    }
}

#[test]
fn impossible_numbers_are_named() {
    let texture = |samples| TextureMap { samples, ..TextureMap::default() };
    for samples in [0, 65] {
        let error = texture(samples).check().unwrap_err().to_string();
        assert!(error.contains("texture-samples") && error.contains("expected 1 to 64"), "{error}");
    }
    assert!(texture(64).check().is_ok());
}
