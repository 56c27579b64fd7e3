//! Photographs of a sample without a marker frame, rendered with a known pose and rectified by the sample's outline.

use std::fs;
use std::path::Path;

use glam::{DVec2, DVec3};
use loden::progress::Silent;
use loden::rectify::{Options, Outcome, Photographs};

const PIXELS: [usize; 2] = [200, 170];
/// Width over height of the sample, whose width is 1.
const ASPECT: f64 = 1.25;
const K1: f64 = -0.05;
/// Texels per side of the blocks in which positions are averaged.
const BLOCK: usize = 8;
/// Texels around them that are left out.
const MARGIN: usize = 2;
const COLUMNS: usize = 40;

/// A camera that looks at the middle of the sample from the direction (theta, phi), turned about its axis by `roll`, degrees.
struct Pose {
    eye: DVec3,
    /// Right, up, forward.
    axes: [DVec3; 3],
}

impl Pose {
    fn new([theta, phi, roll]: [f64; 3]) -> Self {
        let [theta, phi, roll] = [theta, phi, roll].map(f64::to_radians);
        let wo = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        // at roll 0 the sample's upper side is up in the photograph as far as it can be
        let up = (DVec3::Y - wo * wo.y).normalize();
        let right = up.cross(wo);
        let (sin, cos) = roll.sin_cos();
        Self { eye: wo * 5.0, axes: [right * cos + up * sin, up * cos - right * sin, -wo] }
    }

    fn middle() -> DVec2 {
        DVec2::new(PIXELS[0] as f64, PIXELS[1] as f64) / 2.0
    }

    /// Where a point of the plane is seen, in pixels.
    fn seen(&self, point: DVec2) -> DVec2 {
        let d = point.extend(0.0) - self.eye;
        let [x, y, z] = self.axes.map(|axis| axis.dot(d));
        let ideal = DVec2::new(x / z, -y / z) * FOCAL;
        let r = ideal.length() / Self::middle().x;
        Self::middle() + ideal * (1.0 + K1 * r * r)
    }

    /// The point of the plane seen at a place in pixels.
    fn plane(&self, at: DVec2) -> DVec2 {
        let d = at - Self::middle();
        let target = d.length() / Self::middle().x;
        let mut r = target;
        for _ in 0..10 {
            r -= (r * (1.0 + K1 * r * r) - target) / (1.0 + 3.0 * K1 * r * r);
        }
        let ideal = if target > 0.0 { d * (r / target) } else { d } / FOCAL;
        let [right, up, forward] = self.axes;
        let ray = forward + right * ideal.x - up * ideal.y;
        (self.eye - ray * (self.eye.z / ray.z)).truncate()
    }
}

/// Pixels per unit at distance 1.
const FOCAL: f64 = 520.0;

/// The sample: red tells x and green y from its top left corner, blue is a texture that goes to the very edge.
fn sample(point: DVec2, contrast: f64) -> Option<DVec3> {
    let at = DVec2::new(point.x + 0.5, 0.5 - point.y * ASPECT);
    let texture = (37.0 * at.x + 11.0 * at.y).sin() * (23.0 * at.y - 7.0 * at.x).cos();
    ((at - 0.5).abs().max_element() <= 0.5)
        .then(|| DVec3::new(0.1 + 0.3 * at.x, 0.1 + 0.3 * at.y, 0.3 * (1.0 + contrast * texture)))
}

/// A photograph with 16 points per pixel and noise of a hundredth, in 16 bits.
fn photograph(pose: &Pose, background: DVec3, contrast: f64, path: &Path) {
    let noise = |i: usize| ((i as f64 * 0.618_033_988_749_895).fract() - 0.5) * 0.01;
    let pixel = |x: u32, y: u32| {
        let points = (0..16).map(|k| DVec2::new(f64::from(k % 4) + 0.5, f64::from(k / 4) + 0.5) / 4.0);
        let corner = DVec2::new(f64::from(x), f64::from(y));
        let light = |d: DVec2| sample(pose.plane(corner + d), contrast).unwrap_or(background);
        let mean = points.map(light).sum::<DVec3>() / 16.0;
        let i = 3 * (y as usize * PIXELS[0] + x as usize);
        let noisy = [0, 1, 2].map(|k| mean[k] + noise(i + k));
        image::Rgb(noisy.map(|v| (v.clamp(0.0, 1.0) * 65_535.0).round() as u16))
    };
    image::ImageBuffer::from_fn(PIXELS[0] as u32, PIXELS[1] as u32, pixel).save(path).unwrap();
}

fn rectified(path: &Path) -> (Vec<Vec<f32>>, Vec<Outcome>) {
    let options = Options { size: COLUMNS, max_error: 0.5 };
    let photographs = Photographs::open(path).unwrap();
    let meta = photographs.meta(&options);
    assert_eq!([meta.width, meta.height], [40, 32]);
    let mut images = Vec::new();
    let sink = &mut |texels| {
        images.push(texels);
        Ok(())
    };
    let outcomes = photographs.rectify(&options, &Silent, sink).unwrap();
    (images, outcomes)
}

/// How far the corner blocks of an image are from where they should be, in pixels of the photograph at most.
fn off(image: &[f32], pose: &Pose) -> f64 {
    let rows = image.len() / 3 / COLUMNS;
    let mut worst = 0.0f64;
    // texels at the border hold some background: the photograph is blurred by the area of its pixels
    let (right, bottom) = (COLUMNS - BLOCK - MARGIN, rows - BLOCK - MARGIN);
    for (left, top) in [(MARGIN, MARGIN), (right, MARGIN), (MARGIN, bottom), (right, bottom)] {
        let texels = (0..BLOCK * BLOCK).map(|i| (left + i % BLOCK, top + i / BLOCK));
        let shift = texels.map(|(x, y)| {
            let rgb = &image[3 * (y * COLUMNS + x)..];
            let found = DVec2::new(f64::from(rgb[0]), f64::from(rgb[1])) - 0.1;
            found / 0.3 - DVec2::new((x as f64 + 0.5) / COLUMNS as f64, (y as f64 + 0.5) / rows as f64)
        });
        let shift = shift.sum::<DVec2>() / (BLOCK * BLOCK) as f64;
        let middle = DVec2::new((left + BLOCK / 2) as f64 / COLUMNS as f64, (top + BLOCK / 2) as f64 / rows as f64);
        let in_plane = |at: DVec2| DVec2::new(at.x - 0.5, (0.5 - at.y) / ASPECT);
        worst = worst.max(pose.seen(in_plane(middle + shift)).distance(pose.seen(in_plane(middle))));
    }
    worst
}

#[test]
fn the_outline_gives_the_pose_to_a_fraction_of_a_pixel() {
    let dir = tempfile::tempdir().unwrap();
    let poses = [[0.0, 0.0, 0.0], [15.0, 40.0, 10.0], [30.0, 200.0, -20.0], [45.0, 300.0, 25.0], [60.0, 100.0, 5.0]];
    let [dark, coloured] = [DVec3::splat(0.01), DVec3::new(0.25, 0.02, 0.02)];
    // plain, with a texture as deep as it can be, and on a background as bright as parts of the sample
    let cases = [("plain", dark, 0.0), ("textured", dark, 0.9), ("coloured background", coloured, 0.5)];
    for (name, background, contrast) in cases {
        let mut hints = Vec::new();
        for (i, angles) in poses.iter().enumerate() {
            let pose = Pose::new(*angles);
            photograph(&pose, background, contrast, &dir.path().join(format!("v{i}.png")));
            // about the top left corner
            hints.push((pose.seen(DVec2::new(-0.5, 0.5 / ASPECT)) + DVec2::new(6.0, -9.0)).to_array());
        }
        let views: Vec<[f64; 2]> = poses.iter().map(|[theta, phi, _]| [*theta, *phi]).collect();
        let path = dir.path().join("set.toml");
        let text = format!(
            "loden_photographs = 1\nfiles = \"v{{view}}.png\"\nviews = {views:?}\ndistortion = [{K1}, 0.0]\n\n\
             [outline]\naspect = {ASPECT}\ntop_left = {hints:?}\n"
        );
        fs::write(&path, text).unwrap();
        let (images, outcomes) = rectified(&path);
        let errors: Vec<f64> = images.iter().zip(poses).map(|(image, pose)| off(image, &Pose::new(pose))).collect();
        println!(
            "{name}: off by {errors:.3?} pixels; edges off lines by {:.3?}",
            outcomes.iter().map(|o| o.error.unwrap()).collect::<Vec<_>>()
        );
        assert!(outcomes.iter().all(|o| o.refused.is_none()), "{name}: {outcomes:?}");
        assert!(errors.iter().all(|e| *e < 0.15), "{name}: {errors:?}");
    }
}

#[test]
fn what_is_wrong_with_an_outline_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("set.toml");
    photograph(&Pose::new([20.0, 0.0, 0.0]), DVec3::ZERO, 0.0, &dir.path().join("v0.png"));
    let text = "loden_photographs = 1\nfiles = \"v{view}.png\"\nviews = [[20, 0]]\n\n[outline]\naspect = 1.25\n";
    for (from, to, expected) in [
        ("aspect = 1.25", "aspect = 0", "set.toml: outline: aspect: found 0"),
        ("aspect = 1.25", "top_left = [[0, 0], [1, 0]]", "set.toml: outline: found 2 points top_left for 1 views"),
        ("\n\n[", "\ncorners = [[[5, 5], [35, 5], [35, 35], [5, 35]]]\n\n[", "outline: found corners beside"),
        ("aspect", "ratio", "set.toml: line 6"),
    ] {
        fs::write(&path, text.replace(from, to)).unwrap();
        let error = Photographs::open(&path).err().unwrap().to_string();
        assert!(error.contains(expected), "{error}\nshould contain {expected}");
    }
    // nothing before the background, and nothing straight
    let circle = |x: u32, y: u32| (f64::from(x) - 100.0).hypot(f64::from(y) - 85.0) < 60.0;
    for (light, expected) in [(false, "only 0 edge points"), (true, "the edges of the sample deviate by")] {
        let pixel = |x, y| image::Rgb([if light && circle(x, y) { 40_000u16 } else { 0 }; 3]);
        image::ImageBuffer::from_fn(200, 170, pixel).save(dir.path().join("v0.png")).unwrap();
        fs::write(&path, text).unwrap();
        let photographs = Photographs::open(&path).unwrap();
        let error = photographs.rectify(&Options::default(), &Silent, &mut |_| Ok(())).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}\nshould contain {expected}");
    }
}
