//! The colour models of factored `.btf` files (full matrix and per-channel factorisations).

/// Offset that keeps logarithms finite.
pub(crate) const EPSILON: f32 = 1e-5;

/// The colour model that converts reconstructed channels to linear RGB.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ColorModel {
    /// Number of the model in the file.
    pub number: i32,
    /// Mean colour; model 3 only.
    pub mean: [f32; 3],
    /// Matrix of principal colours, row by row; model 3 only.
    pub matrix: [f32; 9],
}

/// Known models, by number.
pub(crate) const NAMES: &[(i32, &str)] = &[
    (0, "RGB"),
    (1, "YUV"),
    (2, "Lab"),
    (3, "PCA"),
    (4, "YCoCg"),
    (5, "spectral"),
    (6, "linear spectral"),
    (9, "log Y, UV"),
    (10, "log Y, signed log UV"),
    (11, "log Y, UV / Y"),
    (12, "log RGB"),
];

crate::words! {
    /// The models in which `.btf` files are written.
    pub(crate) enum Written {
        /// Logarithm of Y, U and V over Y.
        YuvLog = "yuv-log",
        /// Logarithms of R, G and B.
        RgbLog = "rgb-log",
        /// R, G and B.
        Rgb = "rgb",
        /// Y, U and V.
        Yuv = "yuv",
        /// Y, Co and Cg.
        Ycocg = "ycocg",
    }
}

impl Written {
    /// The number of the model in a file.
    pub(crate) fn number(self) -> i32 {
        match self {
            Self::Rgb => 0,
            Self::Yuv => 1,
            Self::Ycocg => 4,
            Self::YuvLog => LOG_Y,
            Self::RgbLog => LOG_RGB,
        }
    }
}

/// Number of the usual model, log Y, UV / Y.
pub(crate) const LOG_Y: i32 = 11;

/// Number of the model of three logarithms.
const LOG_RGB: i32 = 12;

const IDENTITY: [f32; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

impl ColorModel {
    /// A model without a mean and a matrix.
    pub(crate) fn plain(number: i32) -> Self {
        Self { number, mean: [0.0; 3], matrix: IDENTITY }
    }

    /// One encoded channel of linear RGB texels.
    pub(crate) fn channel(&self, channel: usize, rgb: &[f32]) -> Vec<f32> {
        rgb.chunks_exact(3).map(|c| self.encode([c[0], c[1], c[2]])[channel]).collect()
    }

    /// Converts reconstructed channels to linear RGB.
    pub(crate) fn decode(&self, [a, b, c]: [f32; 3]) -> [f32; 3] {
        let log = |v: f32| v.exp() - EPSILON;
        match self.number {
            1 => yuv([a, b, c]),
            2 => lab([a, b, c]),
            3 => [0, 1, 2].map(|i| a * self.matrix[i] + b * self.matrix[3 + i] + c * self.matrix[6 + i] + self.mean[i]),
            4 => [a + b - c, a + c, a - b - c],
            9 => yuv([log(a), b, c]),
            10 => {
                let signed = |v: f32| v.signum() * (v.abs() + EPSILON.ln()).exp();
                yuv([log(a), signed(b), signed(c)])
            }
            11 => {
                let y = log(a);
                yuv([y, b * (y + EPSILON), c * (y + EPSILON)])
            }
            12 => [log(a), log(b), log(c)],
            _ => [a, b, c],
        }
    }

    /// The inverse, for the models that are written: 0, 1, 4, 11 and 12. Negative light counts as 0 where logarithms are
    /// taken: chroma beside a luminance near 0 would be without bounds.
    pub(crate) fn encode(&self, rgb: [f32; 3]) -> [f32; 3] {
        let log = |v: f32| (v + EPSILON).ln();
        let rgb =
            if [LOG_Y, LOG_RGB].contains(&self.number) { rgb.map(|v| if v < 0.0 { 0.0 } else { v }) } else { rgb };
        let [r, g, b] = rgb;
        let to_yuv = || {
            let y = 0.299 * r + 0.587 * g + 0.114 * b;
            [y, (b - y) / 2.03211, (r - y) / 1.13983]
        };
        match self.number {
            1 => to_yuv(),
            4 => [0.25 * (r + 2.0 * g + b), 0.5 * (r - b), 0.5 * (g - 0.5 * (r + b))],
            11 => {
                let [y, u, v] = to_yuv();
                [log(y), u / (y + EPSILON), v / (y + EPSILON)]
            }
            12 => [log(r), log(g), log(b)],
            _ => rgb,
        }
    }
}

fn yuv([y, u, v]: [f32; 3]) -> [f32; 3] {
    [y + 1.13983 * v, y - 0.39465 * u - 0.5806 * v, y + 2.03211 * u]
}

/// CIE Lab with white point D65 to linear sRGB.
fn lab([l, a, b]: [f32; 3]) -> [f32; 3] {
    let fy = (l + 16.0) / 116.0;
    let inverse = |f: f32| if f > 6.0 / 29.0 { f.powi(3) } else { 3.0 * (6.0f32 / 29.0).powi(2) * (f - 4.0 / 29.0) };
    let [x, y, z] = [0.95047 * inverse(fy + a / 500.0), inverse(fy), 1.08883 * inverse(fy - b / 200.0)];
    [3.2406 * x - 1.5372 * y - 0.4986 * z, -0.9689 * x + 1.8758 * y + 0.0415 * z, 0.0557 * x - 0.2040 * y + 1.0570 * z]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_that_are_written_invert() {
        for written in Written::ALL {
            let number = written.number();
            let model = ColorModel::plain(number);
            for rgb in [[0.2, 0.5, 0.9], [0.0, 0.0, 0.0], [1.5, 0.01, 0.3]] {
                let back = model.decode(model.encode(rgb));
                // the published factors of YUV have five digits
                let close = rgb.iter().zip(back).all(|(a, b)| (a - b).abs() < 2e-4);
                assert!(close, "model {number}: {rgb:?} {back:?}");
            }
        }
    }

    #[test]
    fn negative_light_is_black_in_logarithms() {
        for written in [Written::YuvLog, Written::RgbLog] {
            let model = ColorModel::plain(written.number());
            for rgb in [[0.2, -0.5, 0.1], [-0.7, -0.7, -0.7], [-0.1, 0.3, -0.2]] {
                let back = model.decode(model.encode(rgb));
                let close = rgb.iter().zip(back).all(|(a, b)| (a.max(0.0) - b).abs() < 2e-4);
                assert!(close, "{written}: {rgb:?} {back:?}");
            }
        }
    }

    #[test]
    fn white_is_white_in_every_model_with_a_white_point() {
        let model = |number| ColorModel { number, mean: [0.0; 3], matrix: [0.0; 9] };
        let log = (1.0 + EPSILON).ln();
        for (number, channels) in [
            (1, [1.0, 0.0, 0.0]),
            (2, [100.0, 0.0, 0.0]),
            (4, [1.0, 0.0, 0.0]),
            (9, [log, 0.0, 0.0]),
            (11, [log, 0.0, 0.0]),
        ] {
            let rgb = model(number).decode(channels);
            assert!(rgb.iter().all(|v| (v - 1.0).abs() < 1e-3), "{number}: {rgb:?}");
        }
        let pca =
            ColorModel { number: 3, mean: [0.1, 0.2, 0.3], matrix: [1.0, 2.0, 3.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] };
        assert_eq!(pca.decode([1.0, 10.0, 100.0]), [1.1, 12.2, 103.3]);
    }
}
