//! Renders a scene from the photographs of a BTF in three passes over the polar angle of the viewer, the baseline of
//! out-of-core rendering: `three_passes SCENE BTF OUTPUT.exr`.
//!
//! All shapes of the scene have the BTF as material. A pass holds only the photographs of its views (polar angles of 0
//! to 45, 45 to 60, and 60 to 90 degrees) and renders a whole picture, black where another pass applies; the pictures
//! are added. This is the scheme of a shader that runs three times with the textures of a third of the views. It is
//! correct for direct light on objects that the camera sees, so the scene should have depth 2 and a dark background.
//! Prints seconds and bytes of photographs read, as JSON.

use std::borrow::Cow;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use glam::{Vec2, Vec3};
use loden::btf::{BtfMeta, BtfSource, Texels};
use loden::direction::{Interpolator, Scheme};
use loden::material::{Material, RawBtf};
use loden::picture::Picture;
use loden::progress::Silent;
use loden::render::render;
use loden::render::scene_file::SceneFile;
use loden::{Result, import};

/// Polar angles of the views whose photographs each pass holds, in degrees.
const PASSES: [[f64; 2]; 3] = [[0.0, 45.0], [45.0, 60.0], [60.0, 90.0]];

/// The photographs that each pass holds.
fn held(meta: &BtfMeta, pass: usize) -> Vec<bool> {
    let [from, to] = PASSES[pass];
    // angles in files are rounded
    meta.views.degrees().iter().map(|[theta, _]| (from - 0.5..=to + 0.5).contains(theta)).collect()
}

/// A BTF with some views copied into memory; the others share a black one.
struct Part<'a> {
    source: &'a dyn BtfSource,
    held: Vec<bool>,
    black: Vec<u8>,
    read: AtomicU64,
}

impl BtfSource for Part<'_> {
    fn meta(&self) -> &BtfMeta {
        self.source.meta()
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        if !self.held[view] {
            return Ok(Texels::U8(Cow::Borrowed(&self.black)));
        }
        let texels = match self.source.view(view)? {
            Texels::U8(values) => Texels::U8(Cow::Owned(values.into_owned())),
            Texels::F16(values) => Texels::F16(Cow::Owned(values.into_owned())),
            Texels::F32(values) => Texels::F32(Cow::Owned(values.into_owned())),
        };
        self.source.release(view);
        let bytes = texels.len() * self.meta().sample_type.bytes();
        self.read.fetch_add(bytes as u64, Ordering::Relaxed);
        Ok(texels)
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        self.source.image(view, light)
    }

    fn source_bytes(&self) -> u64 {
        self.source.source_bytes()
    }
}

/// The BTF where a pass applies, black elsewhere.
struct Pass<'a> {
    material: RawBtf<&'a Part<'a>>,
    views: Interpolator,
    /// The photographs of all passes.
    held: [Vec<bool>; 3],
    pass: usize,
}

impl Pass<'_> {
    /// The first pass that holds all photographs around the viewer.
    fn in_charge(&self, wo: Vec3) -> Option<usize> {
        let stencil = self.views.stencil(wo);
        let has = |held: &Vec<bool>| stencil.iter().all(|(view, weight)| weight == 0.0 || held[view]);
        self.held.iter().position(has)
    }
}

impl Material for Pass<'_> {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        if wo.z > 0.0 && self.in_charge(wo) == Some(self.pass) {
            return self.material.apparent(uv, wi, wo);
        }
        Vec3::ZERO
    }

    fn texels(&self) -> Option<[usize; 2]> {
        self.material.texels()
    }
}

/// The picture of one pass, and the bytes it read.
fn picture(scene: &SceneFile, source: &dyn BtfSource, pass: usize) -> Result<(Picture, u64)> {
    let meta = source.meta();
    let held = [0, 1, 2].map(|pass| held(meta, pass));
    let black = vec![0; meta.view_len()];
    let part = Part { source, held: held[pass].clone(), black, read: AtomicU64::new(0) };
    let material = RawBtf::new(&part, Scheme::Triangles)?;
    let material = Pass { material, views: Interpolator::new(&meta.views, Scheme::Triangles)?, held, pass };
    let mut wearing = scene.scene();
    wearing.bodies.iter_mut().for_each(|body| body.material = &material);
    let picture = render(&wearing, &scene.settings, &Silent)?;
    drop(wearing);
    Ok((picture, part.read.load(Ordering::Relaxed)))
}

fn main() -> std::result::Result<(), Box<dyn std::error::Error>> {
    let words: Vec<_> = std::env::args().skip(1).collect();
    let [scene, source, output] = &words[..] else { return Err("expected SCENE BTF OUTPUT".into()) };
    let scene = SceneFile::open(scene)?;
    let source: Arc<dyn BtfSource> = import::open(source, &Default::default())?;
    let start = Instant::now();
    let mut sum = Picture::filled(scene.settings.width, scene.settings.height, Vec3::ZERO);
    let mut bytes = 0;
    for pass in 0..PASSES.len() {
        let (picture, read) = picture(&scene, source.as_ref(), pass)?;
        sum.rgb.iter_mut().zip(picture.rgb).for_each(|(sum, rgb)| *sum += rgb);
        bytes += read;
    }
    sum.write(output)?;
    println!(r#"{{"seconds": {:.2}, "read_bytes": {bytes}}}"#, start.elapsed().as_secs_f64());
    Ok(())
}
