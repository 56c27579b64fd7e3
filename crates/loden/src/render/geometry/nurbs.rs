//! Non-uniform rational B-spline surfaces.

use glam::{DVec3, DVec4, Vec2, Vec4, Vec4Swizzles};

use super::{SurfacePoint, tessellate};
use crate::render::MeshData;
use crate::{Error, Result};

/// Highest order, which is the degree plus one.
const MAX_ORDER: usize = 24;

/// Segments of a surface along one direction; with more knot spans, at least two per span.
const STEPS: usize = 32;

/// Maximum number of quadrilaterals of a surface.
const MAX_QUADS: usize = 1 << 22;

/// One direction of a surface: control points, order, knots and the range of the parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct NurbsAxis {
    /// Number of control points.
    pub count: usize,
    /// Degree plus one.
    pub order: usize,
    /// Knots, not decreasing; `count + order` of them.
    pub knots: Vec<f32>,
    /// First and last parameter value.
    pub range: [f32; 2],
}

impl NurbsAxis {
    fn check(&self) -> Result<()> {
        let bad = |problem: String| Err(Error::parameter("knots", problem));
        let Self { count, order, knots, range: [first, last] } = self;
        if !(2..=MAX_ORDER).contains(order) || count < order {
            return bad(format!(
                "found order {order} with {count} points, expected 2 to {MAX_ORDER} and as many points"
            ));
        }
        if knots.len() != count + order {
            return bad(format!("found {} knots, expected {}", knots.len(), count + order));
        }
        if !knots.is_sorted() || !knots.iter().all(|knot| knot.is_finite()) {
            return bad("found decreasing knots".into());
        }
        let [low, high] = self.domain();
        // clamp to the available range
        if first.max(low).partial_cmp(&last.min(high)) != Some(std::cmp::Ordering::Less) {
            return bad(format!("found a range of {first} to {last} within {low} to {high}"));
        }
        Ok(())
    }

    /// The range of parameters where the basis functions are complete.
    fn domain(&self) -> [f32; 2] {
        [self.knots[self.order - 1], self.knots[self.count]]
    }

    /// The parameters of the tessellation: all knots, and even steps between them.
    fn cuts(&self) -> Vec<f64> {
        let [low, high] = self.domain();
        let (first, last) = (f64::from(self.range[0].max(low)), f64::from(self.range[1].min(high)));
        let mut knots: Vec<f64> = self.knots[self.order - 1..=self.count].iter().map(|&knot| knot.into()).collect();
        knots.retain(|knot| *knot > first && *knot < last);
        knots.dedup();
        knots.insert(0, first);
        knots.push(last);
        let spans = knots.len() - 1;
        let steps = if self.order == 2 { 1 } else { (STEPS / spans).clamp(2, STEPS) };
        let inner = knots.windows(2).flat_map(|span| {
            let [a, b] = [span[0], span[1]];
            (0..steps).map(move |k| a + (b - a) * k as f64 / steps as f64)
        });
        let mut cuts: Vec<f64> = inner.collect();
        cuts.push(last);
        cuts
    }

    /// The index of the first point with a weight at a parameter, the weights, and their derivatives.
    fn weights(&self, t: f64) -> (usize, Vec<[f64; 2]>) {
        let knot = |i: usize| f64::from(self.knots[i]);
        let degree = self.order - 1;
        let span = (degree..self.count).rfind(|&i| knot(i) <= t && knot(i) < knot(i + 1)).unwrap_or(degree);
        // Cox and de Boor's recursion; the weights of the next lower degree give the derivatives.
        let mut values = vec![1.0];
        let mut lower = Vec::new();
        for k in 1..=degree {
            let mut next = vec![0.0; k + 1];
            for (j, &value) in values.iter().enumerate() {
                let (left, right) = (knot(span + 1 + j - k), knot(span + 1 + j));
                let part = if right > left { value / (right - left) } else { 0.0 };
                next[j] += (right - t) * part;
                next[j + 1] += (t - left) * part;
            }
            lower = std::mem::replace(&mut values, next);
        }
        let mut both: Vec<[f64; 2]> = values.into_iter().map(|value| [value, 0.0]).collect();
        for (j, &value) in lower.iter().enumerate() {
            let (left, right) = (knot(span + 1 + j - degree), knot(span + 1 + j));
            let part = if right > left { degree as f64 * value / (right - left) } else { 0.0 };
            both[j][1] -= part;
            both[j + 1][1] += part;
        }
        (span - degree, both)
    }
}

/// Tessellates a surface of control points in homogeneous coordinates, u varying fastest. Texture coordinates are the
/// parameters, scaled to 0..1.
///
/// # References
/// piegl1997 (chapters 2 and 4)
///
/// # Errors
/// [`Error::Parameter`] for inconsistent knots, and for a surface that is too large.
pub fn nurbs_mesh(points: &[Vec4], axes: &[NurbsAxis; 2]) -> Result<MeshData> {
    axes.iter().try_for_each(NurbsAxis::check)?;
    let expected = axes[0].count.saturating_mul(axes[1].count);
    if points.len() != expected {
        return Err(Error::parameter("P", format!("found {} points, expected {expected}", points.len())));
    }
    let cuts = axes.each_ref().map(NurbsAxis::cuts);
    let steps = [0, 1].map(|k| cuts[k].len() - 1);
    if steps[0].saturating_mul(steps[1]) > MAX_QUADS {
        return Err(Error::parameter("knots", format!("found more than {MAX_QUADS} quadrilaterals")));
    }
    // The parameter at a fractional step
    let parameter = |axis: usize, fraction: f32| {
        let place = f64::from(fraction) * steps[axis] as f64;
        let first = (place as usize).min(steps[axis] - 1);
        let (a, b) = (cuts[axis][first], cuts[axis][first + 1]);
        a + (b - a) * (place - first as f64)
    };
    let ends = [0, 1].map(|axis| [cuts[axis][0], cuts[axis][steps[axis]]]);
    let mut data = MeshData::default();
    tessellate(&mut data, steps, |fu, fv| {
        let (u, v) = (parameter(0, fu), parameter(1, fv));
        let ((first_u, weights_u), (first_v, weights_v)) = (axes[0].weights(u), axes[1].weights(v));
        let [mut p, mut pu, mut pv] = [DVec4::ZERO; 3];
        for (j, [bv, dv]) in weights_v.iter().enumerate() {
            for (i, [bu, du]) in weights_u.iter().enumerate() {
                let point = points[(first_v + j) * axes[0].count + first_u + i].as_dvec4();
                p += point * (bu * bv);
                pu += point * (du * bv);
                pv += point * (bu * dv);
            }
        }
        let position: DVec3 = p.xyz() / p.w;
        let slope = |d: DVec4| ((d.xyz() - position * d.w) / p.w).as_vec3();
        let scaled = |axis: usize, t: f64| ((t - ends[axis][0]) / (ends[axis][1] - ends[axis][0])) as f32;
        let uv = Vec2::new(scaled(0, u), scaled(1, v));
        SurfacePoint { position: position.as_vec3(), dpdu: slope(pu), dpdv: slope(pv), uv }
    });
    if data.positions.iter().any(|p| !p.is_finite()) {
        return Err(Error::parameter("Pw", "found a weight of 0"));
    }
    Ok(data)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn a_rational_quarter_circle_is_round() {
        // A cylinder of radius 1: three rational points around, two along.
        let w = 0.5f32.sqrt();
        let around = [Vec4::new(1.0, 0.0, 0.0, 1.0), Vec4::new(w, w, 0.0, w), Vec4::new(0.0, 1.0, 0.0, 1.0)];
        let points: Vec<Vec4> = [0.0, 2.0].iter().flat_map(|z| around.map(|p| p + Vec4::Z * (z * p.w))).collect();
        let axes = [
            NurbsAxis { count: 3, order: 3, knots: vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0], range: [0.0, 1.0] },
            NurbsAxis { count: 2, order: 2, knots: vec![0.0, 0.0, 1.0, 1.0], range: [0.0, 1.0] },
        ];
        let data = nurbs_mesh(&points, &axes).unwrap();
        for (p, n) in data.positions.iter().zip(&data.normals) {
            let radial = Vec3::new(p.x, p.y, 0.0);
            assert!((radial.length() - 1.0).abs() < 1e-6 && (0.0..=2.0).contains(&p.z), "{p}");
            assert!((*n - radial).length() < 1e-4, "{p} {n}");
        }
    }

    #[test]
    fn uniform_splines_reproduce_bilinear_heights() {
        let knots: Vec<f32> = (0..9).map(|k| k as f32).collect();
        let axis = NurbsAxis { count: 5, order: 4, knots, range: [3.0, 5.0] };
        // The Greville abscissa of point i is i + 2.
        let points: Vec<Vec4> = (0..25)
            .map(|k| {
                let (x, y) = ((k % 5) as f32 + 2.0, (k / 5) as f32 + 2.0);
                Vec4::new(x, y, x * y, 1.0)
            })
            .collect();
        let data = nurbs_mesh(&points, &[axis.clone(), axis.clone()]).unwrap();
        for (p, uv) in data.positions.iter().zip(&data.uvs) {
            assert!((p.z - p.x * p.y).abs() < 1e-5 && (p.x - 3.0 - 2.0 * uv.x).abs() < 1e-5, "{p} {uv}");
        }
        for wrong in [
            NurbsAxis { order: 6, ..axis.clone() },
            NurbsAxis { order: 1, ..axis.clone() },
            NurbsAxis { range: [7.0, 8.0], ..axis.clone() },
            NurbsAxis { knots: vec![0.0; 8], ..axis.clone() },
            NurbsAxis { knots: vec![0.0; 9], ..axis.clone() },
        ] {
            assert!(nurbs_mesh(&points, &[wrong.clone(), axis.clone()]).is_err(), "{wrong:?}");
        }
    }
}
