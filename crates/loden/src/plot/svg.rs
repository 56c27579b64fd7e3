//! A minimal SVG writer for curves and text.

use std::fmt::Write;

/// Colours that differ in lightness as well as in hue.
const COLORS: [&str; 12] = [
    "#1b1b1b", "#d1495b", "#2e86ab", "#66a182", "#edae49", "#7b4b94", "#8d6a4f", "#5fb0b7", "#e0559b", "#3b5f41",
    "#9aa0a6", "#f07f4f",
];

/// The colour of curve number `k`.
pub(super) fn color(k: usize) -> &'static str {
    COLORS[k % COLORS.len()]
}

/// A drawing in pixels with the origin at the upper left.
pub(super) struct Svg {
    body: String,
    width: f64,
    height: f64,
}

/// Escapes text for XML.
pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

impl Svg {
    pub(super) fn new(width: f64, height: f64) -> Self {
        Self { body: String::new(), width, height }
    }

    pub(super) fn curve(&mut self, points: &[(f64, f64)], color: &str, width: f64) {
        let path: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        // Writing to a string cannot fail.
        let _ = writeln!(
            self.body,
            "<polyline fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\" points=\"{}\"/>",
            path.join(" ")
        );
    }

    pub(super) fn text(&mut self, (x, y): (f64, f64), anchor: &str, text: &str) {
        let _ = writeln!(
            self.body,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"#333\">{}</text>",
            escape(text)
        );
    }

    /// Adds the legend of curve number `k`.
    pub(super) fn legend(&mut self, k: usize, (x, y): (f64, f64), name: &str) {
        self.curve(&[(x, y - 4.0), (x + 18.0, y - 4.0)], color(k), 2.5);
        self.text((x + 24.0, y), "start", name);
    }

    pub(super) fn finish(self) -> String {
        let Self { body, width, height } = self;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n{body}</svg>\n"
        )
    }
}
