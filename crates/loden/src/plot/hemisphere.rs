//! Reflectance over the hemisphere of view directions, shown as a disc.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::direction::from_angles;
use crate::material::Material;
use crate::picture::Picture;

/// Renders one disc of `size` pixels per light. The polar angle of the view grows linearly from the centre (0) to the
/// edge (90 degrees); its azimuth runs counter-clockwise from the right. The light comes from the left (azimuth 180
/// degrees), so the mirror direction is on the right. Pixels show f cos(theta_i) pi: 1 for white diffuse lit from
/// above.
pub fn hemisphere(material: &dyn Material, light_degrees: &[f32], size: usize) -> Picture {
    let mut picture = Picture::filled(size * light_degrees.len(), size, Vec3::ZERO);
    let width = picture.width;
    picture.rgb.par_iter_mut().enumerate().for_each(|(i, pixel)| {
        let (x, y) = (i % width, i / width);
        let wi = from_angles(light_degrees[x / size].to_radians(), std::f32::consts::PI);
        let at = (Vec2::new((x % size) as f32, y as f32) + 0.5) / size as f32 * 2.0 - 1.0;
        let radius = at.length() / 0.96;
        if radius < 1.0 {
            let wo = from_angles(radius * std::f32::consts::FRAC_PI_2, (-at.y).atan2(at.x));
            *pixel = material.apparent(Vec2::ZERO, wi, wo);
        }
    });
    picture
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Analytic, by_name};
    use crate::params::Values;

    #[test]
    fn the_highlight_is_opposite_the_light() {
        let model = by_name("phong").unwrap();
        let brdf = Analytic::new(model, Values::defaults(model.params())).unwrap();
        let picture = hemisphere(&brdf, &[45.0], 64);
        let brightest = (0..64 * 64).max_by(|&a, &b| picture.rgb[a].y.total_cmp(&picture.rgb[b].y)).unwrap();
        let (x, y) = (brightest % 64, brightest / 64);
        // Halfway from the centre to the right edge.
        assert!((46..49).contains(&x) && (30..34).contains(&y), "{x} {y}");
        assert_eq!(picture.at(0, 0), Vec3::ZERO);
    }
}
