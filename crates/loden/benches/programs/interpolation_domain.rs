//! Measures whether images between sampled directions are predicted better in linear light or as display values.
//!
//! Usage: `interpolation_domain COARSE FINE`, two BTFs of one sample with different directions: images of the second are
//! predicted from those of the first. Prints a Markdown table: the mean signed difference over the mean value (what is
//! too bright or too dark), the mean absolute difference over the mean value, and the root mean square difference, in
//! linear light and, for the last, in display values.

use glam::Vec3;
use loden::btf::BtfSource;
use loden::color::Encoding;
use loden::direction::{Interpolator, Scheme};
use loden::import;

#[derive(Default)]
struct Sums {
    signed: f64,
    absolute: f64,
    squares: f64,
    display: f64,
    value: f64,
    count: f64,
}

impl Sums {
    fn add(&mut self, found: f32, truth: f32) {
        let shown = |v: f32| f64::from(Encoding::Srgb.encode(v.clamp(0.0, 1.0)));
        let difference = f64::from(found) - f64::from(truth);
        self.signed += difference;
        self.absolute += difference.abs();
        self.squares += difference * difference;
        self.display += (shown(found) - shown(truth)).powi(2);
        self.value += f64::from(truth);
        self.count += 1.0;
    }

    fn cells(&self) -> String {
        let percent = |v: f64| 100.0 * v / self.value;
        let root = |v: f64| (v / self.count).sqrt();
        let (signed, absolute) = (percent(self.signed), percent(self.absolute));
        format!("{signed:+.2} % | {absolute:.2} % | {:.5} | {:.5}", root(self.squares), root(self.display))
    }
}

fn open(path: &str) -> loden::Result<std::sync::Arc<dyn BtfSource>> {
    let (_, measured) = import::open_named(path, &Default::default())?;
    measured.images().map_err(|_| loden::Error::parameter(path, "is no BTF"))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let [coarse, fine] = &paths[..] else { return Err("usage: interpolation_domain COARSE FINE".into()) };
    let (coarse, fine) = (open(coarse)?, open(fine)?);
    let (from, to) = (coarse.meta(), fine.meta());
    assert_eq!((from.width, from.height), (to.width, to.height), "both have the same texels");
    let images: Vec<Vec<f32>> = (0..from.views.len())
        .map(|view| coarse.view(view).map(|texels| texels.to_f32().into_owned()))
        .collect::<Result<_, _>>()?;
    let views = Interpolator::new(&from.views, Scheme::Triangles)?;
    let lights = Interpolator::new(&from.lights, Scheme::Triangles)?;
    // below the last ring values are continued, not interpolated
    let within = |w: &Vec3| w.z > 75.01f32.to_radians().cos();
    let (linear_of, display_of) =
        (|v: f32| from.encoding.decode(v), |v: f32| from.encoding.display().encode(from.encoding.decode(v)));
    let (mut linear, mut display) = (Sums::default(), Sums::default());
    for (v, wo) in to.views.directions().iter().enumerate().filter(|(_, w)| within(w)) {
        for (l, wi) in to.lights.directions().iter().enumerate().filter(|(_, w)| within(w)) {
            let (view, light) = (views.stencil(*wo), lights.stencil(*wi));
            for (i, truth) in fine.image(v, l)?.to_f32().iter().enumerate() {
                let (mut a, mut b) = (0.0, 0.0);
                for (view, p) in view.iter() {
                    for (light, q) in light.iter() {
                        let stored = images[view][light * from.image_len() + i];
                        a += p * q * linear_of(stored);
                        b += p * q * display_of(stored);
                    }
                }
                let truth = to.encoding.decode(*truth);
                linear.add(a, truth);
                display.add(from.encoding.display().decode(b), truth);
            }
        }
    }
    println!("| interpolated | bias | mean difference | rms | rms of display values |\n|---|---|---|---|---|");
    println!("| in linear light | {} |", linear.cells());
    println!("| as display values | {} |", display.cells());
    Ok(())
}
