//! Error curves on logarithmic axes.

use super::svg::{Svg, color};

const SIZE: (f64, f64) = (860.0, 520.0);
/// The plotting area: left, right, top, bottom.
const FIELD: [f64; 4] = [70.0, 660.0, 20.0, 470.0];

/// Labelled curves.
type Curves = [(String, Vec<(f64, f64)>)];

/// Plots labelled curves of points (bytes, mean error) as SVG.
///
/// # Limits
/// Points with a coordinate that is not positive are omitted.
pub fn rate_distortion(curves: &Curves) -> String {
    logarithmic(curves, "bytes")
}

/// Plots labelled curves of points (components, mean error); see [`rate_distortion`].
pub fn error_of_components(curves: &Curves) -> String {
    logarithmic(curves, "components")
}

fn logarithmic(curves: &Curves, along_x: &str) -> String {
    let mut svg = Svg::new(SIZE.0, SIZE.1);
    let shown = |&(x, y): &(f64, f64)| x > 0.0 && y > 0.0 && x.is_finite() && y.is_finite();
    let all: Vec<(f64, f64)> = curves.iter().flat_map(|(_, points)| points.iter().copied().filter(shown)).collect();
    let bounds = |of: &dyn Fn(&(f64, f64)) -> f64| {
        let (low, high) = all.iter().map(of).fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        if low <= high { (low / 1.1, high * 1.1) } else { (1.0, 10.0) }
    };
    let (x, y) = (bounds(&|p| p.0), bounds(&|p| p.1));
    let [left, right, top, bottom] = FIELD;
    let along = |v: f64, (low, high): (f64, f64)| (v / low).ln() / (high / low).ln();
    let place = |&(a, b): &(f64, f64)| (left + along(a, x) * (right - left), bottom - along(b, y) * (bottom - top));
    for tick in ticks(x) {
        let (at, _) = place(&(tick, y.0));
        svg.curve(&[(at, top), (at, bottom)], "#ddd", 1.0);
        svg.text((at, bottom + 18.0), "middle", &short(tick));
    }
    for tick in ticks(y) {
        let (_, at) = place(&(x.0, tick));
        svg.curve(&[(left, at), (right, at)], "#ddd", 1.0);
        svg.text((left - 8.0, at + 4.0), "end", &format!("{tick}"));
    }
    svg.text((0.5 * (left + right), bottom + 40.0), "middle", along_x);
    svg.text((left, top - 6.0), "end", "mean error");
    for (k, (name, points)) in curves.iter().enumerate() {
        let mut points: Vec<(f64, f64)> = points.iter().copied().filter(shown).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let places: Vec<(f64, f64)> = points.iter().map(place).collect();
        svg.curve(&places, color(k), 2.0);
        for (x, y) in places {
            // A small square, drawn as a short thick line.
            svg.curve(&[(x - 3.0, y), (x + 3.0, y)], color(k), 6.0);
        }
        svg.legend(k, (right + 20.0, top + 14.0 + 20.0 * k as f64), name);
    }
    svg.finish()
}

/// 1, 2 and 5 times the powers of ten within the bounds.
fn ticks((low, high): (f64, f64)) -> Vec<f64> {
    let powers = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let all = powers.flat_map(|p| [1.0, 2.0, 5.0].map(|m| format!("{m}e{p}").parse().unwrap_or(1.0)));
    all.filter(|tick| (low..=high).contains(tick)).collect()
}

/// Formats 20000 as "20 k".
fn short(number: f64) -> String {
    match number {
        b if b >= 1e9 => format!("{} G", b / 1e9),
        b if b >= 1e6 => format!("{} M", b / 1e6),
        b if b >= 1e3 => format!("{} k", b / 1e3),
        b => format!("{b}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_lie_in_the_field_and_equal_ratios_are_equal_steps() {
        let curves = [("a & b".to_owned(), vec![(1e3, 0.1), (1e4, 0.05), (1e5, 0.025), (0.0, 1.0)])];
        let svg = rate_distortion(&curves);
        assert!(svg.contains("a &amp; b") && svg.contains("10 k"));
        let line = svg.lines().find(|line| line.contains("stroke-width=\"2\"")).unwrap();
        let points = line.split("points=\"").nth(1).unwrap().trim_end_matches("\"/>");
        let points: Vec<Vec<f64>> =
            points.split(' ').map(|p| p.split(',').map(|v| v.parse().unwrap()).collect()).collect();
        assert_eq!(points.len(), 3);
        let [left, right, top, bottom] = FIELD;
        assert!(points.iter().all(|p| (left..right).contains(&p[0]) && (top..bottom).contains(&p[1])));
        let step = |i: usize, axis: usize| points[i + 1][axis] - points[i][axis];
        assert!((step(0, 0) - step(1, 0)).abs() < 0.2 && (step(0, 1) - step(1, 1)).abs() < 0.2 && step(0, 1) > 0.0);
    }
}
