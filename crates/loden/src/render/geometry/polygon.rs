//! Triangulation of polygons with holes.

use earcut::Earcut;
use glam::{Vec2, Vec3};

use crate::{Error, Result};

/// Maximum number of corners of one convex polygon.
const MAX_CORNERS: usize = 1 << 24;

/// Maximum number of corners of another polygon; the time to cut it into triangles grows with the square.
const MAX_CUT_CORNERS: usize = 1 << 15;

/// Triangulates polygons. Each polygon is a list of loops of vertex indices: an outline, then holes. The triangles keep
/// the orientation of the outline. Returns the corners of each triangle as indices into all loops of all polygons,
/// concatenated.
///
/// # Errors
/// [`Error::Parameter`] naming a polygon that has too many corners or refers to a vertex that does not exist.
pub fn polygons(positions: &[Vec3], polygons: &[Vec<Vec<u32>>]) -> Result<Vec<[u32; 3]>> {
    let mut cutter = Earcut::new();
    let mut triangles = Vec::new();
    let mut places: Vec<u32> = Vec::new();
    let mut first = 0;
    for (k, loops) in polygons.iter().enumerate() {
        let bad = |problem: String| Err(Error::parameter(format!("polygon {k}"), problem));
        let corners: Vec<u32> = loops.iter().flatten().copied().collect();
        if let Some(index) = corners.iter().find(|&&i| i as usize >= positions.len()) {
            return bad(format!("found vertex index {index}, but there are {} vertices", positions.len()));
        }
        if corners.len() > MAX_CORNERS {
            return bad(format!("found {} corners, more than the limit of {MAX_CORNERS}", corners.len()));
        }
        // Project the polygon
        let points: Vec<Vec3> = corners.iter().map(|&i| positions[i as usize]).collect();
        let normal = newell(&points[..loops.first().map_or(0, Vec::len)]);
        // Project along the major axis of the normal, preserving the orientation of the outline.
        let a = normal.abs();
        let flat = |p: &Vec3| {
            if a.z >= a.x && a.z >= a.y {
                Vec2::new(p.x, p.y * normal.z.signum())
            } else if a.x >= a.y {
                Vec2::new(p.y, p.z * normal.x.signum())
            } else {
                Vec2::new(p.z, p.x * normal.y.signum())
            }
        };
        let flat: Vec<Vec2> = points.iter().map(flat).collect();
        // Triangulate it
        if loops.len() == 1 && is_convex(&flat) {
            cut_convex(first, first + points.len() as u32 - 1, &mut triangles);
        } else if corners.len() > MAX_CUT_CORNERS {
            let limit = format!("the limit of {MAX_CUT_CORNERS} for polygons that are not convex");
            return bad(format!("found {} corners, more than {limit}", corners.len()));
        } else {
            let holes: Vec<u32> = loops
                .iter()
                .scan(0, |end, l| {
                    *end += l.len() as u32;
                    Some(*end)
                })
                .take(loops.len().saturating_sub(1))
                .collect();
            cutter.earcut(flat.iter().map(|p| [f64::from(p.x), f64::from(p.y)]), &holes, &mut places);
            triangles.extend(places.chunks_exact(3).map(|t| {
                let [p, q, r] = [0, 1, 2].map(|i| flat[t[i] as usize]);
                let [a, b, c] = [0, 1, 2].map(|i| first + t[i]);
                if (q - p).perp_dot(r - p) < 0.0 { [a, c, b] } else { [a, b, c] }
            }));
        }
        first += corners.len() as u32;
    }
    Ok(triangles)
}

/// Cuts the convex polygon of the corners `first` to `last` into triangles: a few as a fan, many by halves, so that no
/// corner has more than a few and none is long and thin across the whole polygon.
fn cut_convex(first: u32, last: u32, triangles: &mut Vec<[u32; 3]>) {
    if last - first < 8 {
        triangles.extend((first + 1..last).map(|i| [first, i, i + 1]));
        return;
    }
    let middle = first + (last - first) / 2;
    cut_convex(first, middle, triangles);
    triangles.push([first, middle, last]);
    cut_convex(middle, last, triangles);
}

/// The area vector of a closed polyline, planar or not.
fn newell(points: &[Vec3]) -> Vec3 {
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).map(|(a, b)| (*a - points[0]).cross(*b - points[0])).sum()
}

/// Whether a closed polyline is convex and counter-clockwise, up to rounding of its coordinates.
fn is_convex(points: &[Vec2]) -> bool {
    let n = points.len();
    if n < 3 {
        return false;
    }
    let reach = points.iter().map(|p| p.abs().max_element()).fold(0.0, f32::max);
    let slack = |a: Vec2, b: Vec2| 4.0 * f32::EPSILON * reach * (a.length() + b.length());
    let turn = |i: usize| (points[(i + 1) % n] - points[i], points[(i + 2) % n] - points[(i + 1) % n]);
    let turns_left = |i: usize| {
        let (a, b) = turn(i);
        a.perp_dot(b) >= -slack(a, b)
    };
    // A star turns left everywhere but winds around more than once. The fan detects it, and an outline that bends the
    // other way in steps too small to notice; in a star of many corners, the angles tell.
    let fan = (1..n - 1).map(|i| (points[i] - points[0]).perp_dot(points[i + 1] - points[0]));
    let [outside, inside] = fan.fold([0.0f64; 2], |[outside, inside], area| {
        [outside - f64::from(area.min(0.0)), inside + f64::from(area.max(0.0))]
    });
    let angle = |(a, b): (Vec2, Vec2)| f64::from(a.perp_dot(b).atan2(a.dot(b)));
    let winds_once = || n <= 64 || (0..n).map(|i| angle(turn(i))).sum::<f64>() < 3.0 * std::f64::consts::PI;
    (0..n).all(turns_left) && outside <= 1e-5 * inside && winds_once()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(positions: &[Vec3], corners: &[u32], triangles: &[[u32; 3]]) -> Vec3 {
        let of = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| positions[corners[i as usize] as usize]);
            0.5 * (b - a).cross(c - a)
        };
        triangles.iter().map(of).sum()
    }

    #[test]
    fn holes_and_concave_corners_are_not_covered() {
        let turn = glam::Quat::from_euler(glam::EulerRot::XYZ, 0.9, -2.0, 0.4);
        let flat = [
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 4.0],
            [2.0, 1.0],
            [0.0, 4.0], // a notch in the upper edge
            [1.0, 0.2],
            [3.0, 0.2],
            [3.0, 0.7],
            [1.0, 0.7], // a hole
        ];
        let positions: Vec<Vec3> = flat.map(|[x, y]| turn * Vec3::new(x, y, 7.0)).into();
        let square = |reverse: bool| {
            let mut hole = vec![5, 6, 7, 8];
            if reverse {
                hole.reverse();
            }
            vec![vec![0, 1, 2, 3, 4], hole]
        };
        for loops in [square(false), square(true)] {
            let corners: Vec<u32> = loops.iter().flatten().copied().collect();
            let found = polygons(&positions, &[loops]).unwrap();
            let area = area(&positions, &corners, &found);
            assert!((area - turn * Vec3::Z * (16.0 - 6.0 - 1.0)).length() < 1e-3, "{area}");
        }
        let convex = polygons(&positions, &[vec![vec![0, 1, 2]], vec![vec![5, 8, 7, 6]]]).unwrap();
        assert_eq!(convex, [[0, 1, 2], [3, 4, 5], [3, 5, 6]]);
        assert!(polygons(&positions, &[vec![vec![0, 1]]]).unwrap().is_empty());
        assert!(polygons(&positions, &[vec![]]).unwrap().is_empty());
        assert!(polygons(&positions, &[vec![vec![0, 1, 9]]]).unwrap_err().to_string().contains("polygon 0"));
    }
    fn round(count: u32, radius: impl Fn(u32) -> f32) -> Vec<Vec3> {
        let angle = |k: u32| std::f32::consts::TAU * k as f32 / count as f32;
        (0..count).map(|k| radius(k) * Vec3::new(angle(k).cos(), angle(k).sin(), 0.0)).collect()
    }

    #[test]
    fn round_polygons_of_many_corners_are_convex() {
        let n = 200_000;
        let positions = round(n, |_| 3.0);
        let outline: Vec<u32> = (0..n).collect();
        let triangles = polygons(&positions, &[vec![outline.clone()]]).unwrap();
        assert_eq!(triangles.len(), 199_998);
        assert!((area(&positions, &outline, &triangles).z / (9.0 * std::f32::consts::PI) - 1.0).abs() < 1e-4);
        // A gear and a star of as many corners are not.
        let gear = round(n, |k| 3.0 - (k % 2) as f32);
        assert!(polygons(&gear, &[vec![outline]]).unwrap_err().to_string().contains("not convex"));
        let star: Vec<u32> = (0..n - 1).map(|k| 2 * k % (n - 1)).collect();
        assert!(polygons(&positions, &[vec![star]]).is_err());
        // A crescent, whose inner edge bends inwards by less than rounding in each step
        let crescent: Vec<Vec3> = (0..=n)
            .map(|k| {
                let angle = std::f32::consts::PI * (k % (n / 2 + 1)) as f32 / (n / 2) as f32;
                let (sin, cos) = if k <= n / 2 { angle.sin_cos() } else { (0.5 * angle.sin(), -angle.cos()) };
                Vec3::new(cos, sin, 0.0)
            })
            .collect();
        assert!(polygons(&crescent, &[vec![(0..=n).collect()]]).is_err());
    }
}
