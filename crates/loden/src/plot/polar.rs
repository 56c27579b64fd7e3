//! Curves: reflectance in the plane of incidence, and albedo over the polar angle of the view.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{Vec2, Vec3};

use super::NamedMaterial;
use super::svg::{Svg, color};
use crate::direction::from_angles;
use crate::material::Material;

/// Radius of a polar plot, the margin around it and the space between two, in pixels.
const RADIUS: f64 = 200.0;
const MARGIN: f64 = 44.0;
const BETWEEN: f64 = 76.0;

fn mean(c: Vec3) -> f64 {
    f64::from(c.element_sum() / 3.0).max(0.0)
}

/// Plots slices through the plane of incidence as SVG: one panel per polar angle of the light, one curve per material.
/// The angle is that of the view, the distance from the centre the cube root of f_r, averaged over the channels. The
/// light comes from the left.
pub fn polar(materials: &[NamedMaterial], light_degrees: &[f32]) -> String {
    let cell = 2.0 * RADIUS + BETWEEN;
    let slice = |material: &dyn Material, light: f32| -> Vec<(f64, f64)> {
        let wi = from_angles(light.to_radians(), PI);
        let value = |t: f32| {
            let wo = from_angles(t.abs(), if t < 0.0 { PI } else { 0.0 });
            (f64::from(t), mean(material.eval(Vec2::ZERO, wi, wo)).cbrt())
        };
        (-178..=178).map(|i| value(i as f32 / 2.0 * PI / 180.0)).collect()
    };
    let height = RADIUS + 2.0 * MARGIN + 12.0 + 18.0 * materials.len() as f64;
    let mut svg = Svg::new(cell * light_degrees.len() as f64 - BETWEEN + 2.0 * MARGIN, height);
    for (panel, &light) in light_degrees.iter().enumerate() {
        let curves: Vec<_> = materials.iter().map(|(_, material)| slice(*material, light)).collect();
        let most = curves.iter().flatten().map(|p| p.1).fold(1e-12, f64::max);
        let (x, y) = (MARGIN + cell * panel as f64 + RADIUS, MARGIN + RADIUS);
        let at = |t: f64, r: f64| (x + RADIUS * r * t.sin(), y - RADIUS * r * t.cos());
        // Draw the grid and the direction of the light
        for ring in [0.25, 0.5, 0.75, 1.0] {
            let arc: Vec<_> = (-90..=90).step_by(3).map(|d| at(f64::from(d).to_radians(), ring)).collect();
            svg.curve(&arc, "#ddd", 1.0);
            // the scale of the rings, to the right of the centre, below the horizon
            svg.text((x + RADIUS * ring, y + 12.0), "end", &short((ring * most).powi(3)));
        }
        svg.text((x, y + 12.0), "middle", "0");
        for spoke in (-90i32..=90).step_by(30) {
            let angle = f64::from(spoke).to_radians();
            svg.curve(&[(x, y), at(angle, 1.0)], "#ddd", 1.0);
            let (left, top) = at(angle, 1.03);
            let anchor = ["end", "middle", "start"][(spoke.signum() + 1) as usize];
            // the light's side is the left one
            svg.text((left, top), anchor, &format!("{}\u{b0}", spoke.abs()));
        }
        svg.curve(&[(x, y), at(-f64::from(light.to_radians()), 1.0)], "#e0a000", 1.5);
        // Draw the curves
        for (k, curve) in curves.iter().enumerate().rev() {
            let points: Vec<_> = curve.iter().map(|&(t, r)| at(t, r / most)).collect();
            svg.curve(&points, color(k), 1.8);
        }
        let title = format!("light at {light:.0} degrees; rings: f_r in 1/sr");
        svg.text((x, MARGIN - 24.0), "middle", &title);
    }
    for (k, (name, _)) in materials.iter().enumerate() {
        svg.legend(k, (MARGIN, RADIUS + 2.0 * MARGIN + 12.0 + 18.0 * k as f64), name);
    }
    svg.finish()
}

/// A number with two significant digits.
fn short(value: f64) -> String {
    match format!("{value:.1e}").parse::<f64>() {
        Ok(rounded) if (0.001..1e4).contains(&rounded) => rounded.to_string(),
        _ => format!("{value:.1e}"),
    }
}

/// Plots the directional albedo, the reflected fraction of uniform illumination, over the polar angle of the view as SVG.
pub fn albedo(materials: &[NamedMaterial]) -> String {
    let (width, height) = (480.0, 320.0);
    let mut svg = Svg::new(width + 2.0 * MARGIN, height + 2.0 * MARGIN + 18.0 * materials.len() as f64);
    let angles: Vec<f32> = (0..30).map(|i| i as f32 * 3.0 + 0.5).collect();
    let curves: Vec<Vec<f64>> = materials
        .iter()
        .map(|(_, material)| {
            angles.iter().map(|t| mean(directional_albedo(*material, from_angles(t.to_radians(), 0.0)))).collect()
        })
        .collect();
    let most = curves.iter().flatten().copied().fold(1.0f64, f64::max);
    let at = |t: f64, v: f64| (MARGIN + width * t / 90.0, MARGIN + height * (1.0 - v / most));
    for i in 0..=4 {
        let value = most * f64::from(i) / 4.0;
        svg.curve(&[at(0.0, value), at(90.0, value)], "#ddd", 1.0);
        svg.text((MARGIN - 4.0, at(0.0, value).1 + 4.0), "end", &format!("{value:.2}"));
    }
    for t in (0..=90).step_by(15) {
        svg.curve(&[at(f64::from(t), 0.0), at(f64::from(t), most)], "#eee", 1.0);
        svg.text((at(f64::from(t), 0.0).0, MARGIN + height + 16.0), "middle", &t.to_string());
    }
    for (k, curve) in curves.iter().enumerate().rev() {
        let points: Vec<_> = angles.iter().zip(curve).map(|(t, v)| at(f64::from(*t), *v)).collect();
        svg.curve(&points, color(k), 1.8);
    }
    svg.text((MARGIN, MARGIN - 12.0), "start", "albedo over the polar angle of the view, degrees");
    for (k, (name, _)) in materials.iter().enumerate() {
        svg.legend(k, (MARGIN, height + 2.0 * MARGIN + 14.0 + 18.0 * k as f64), name);
    }
    svg.finish()
}

/// Directional albedo by a sum over 60 x 120 cosine-distributed directions.
fn directional_albedo(material: &dyn Material, wo: Vec3) -> Vec3 {
    let (rings, steps) = (60, 120);
    let mut sum = Vec3::ZERO;
    for ring in 0..rings {
        // Uniform in sin^2 theta is cosine-weighted.
        let theta = ((ring as f32 + 0.5) / rings as f32).sqrt().asin().min(FRAC_PI_2);
        for step in 0..steps {
            let wi = from_angles(theta, TAU * (step as f32 + 0.5) / steps as f32);
            sum += material.eval(Vec2::ZERO, wi, wo);
        }
    }
    sum * PI / (rings * steps) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Lambert;

    #[test]
    fn curves_are_labelled_and_reach_the_edge() {
        let grey = Lambert { albedo: Vec3::splat(0.5) };
        let text = polar(&[("a < b", &grey)], &[30.0, 60.0]);
        assert!(
            text.contains("a &lt; b")
                && text.contains(">0.16<")
                && text.contains(">60\u{b0}<")
                && text.contains("light at 60"),
            "{text}"
        );
        assert!(!text.contains("NaN"));
        // A diffuse slice is a half circle, with its top straight above the centre.
        assert!(text.contains("244.0,44.0"), "{text}");
    }

    #[test]
    fn albedo_of_a_diffuse_material_is_flat() {
        let grey = Lambert { albedo: Vec3::splat(0.5) };
        for t in [0.0, 0.7, 1.4] {
            assert!((directional_albedo(&grey, from_angles(t, 1.0)) - Vec3::splat(0.5)).abs().max_element() < 1e-4);
        }
        assert!(albedo(&[("grey", &grey)]).contains("grey"));
    }
}
