//! The page of a sweep.

use std::sync::Arc;

use loden::btf::BtfSource;
use loden::codec::{self, lossless::STAGES};
use loden::direction::{Scheme, from_angles};
use loden::job::{self, ERROR_GAIN, Look, SweepRow, draw, error_picture, shown_pairs, stored_picture};
use loden::material::{Material, RawBtf};
use loden::picture::Picture;
use loden::plot::{error_of_components, rate_distortion};

use super::super::page::Page;
use super::Sweep;
use crate::report;
use crate::terminal::Terminal;

/// JPEG quality of the pictures.
const QUALITY: u8 = 80;

/// Methods per row of images.
const BESIDE: usize = 6;

/// Published figures of a 256 x 256 wool: components, mean error, ratio to the JPEG files.
const TABLE_7_1: [(&str, &str, &str); 8] = [
    ("2", "0.0405", "8.5237"),
    ("4", "0.0344", "4.4001"),
    ("7", "0.0272", "2.5300"),
    ("9", "0.0247", "1.9766"),
    ("15", "0.0203", "1.1906"),
    ("17", "0.0189", "1.0520"),
    ("22", "0.0164", "0.8148"),
    ("30", "0.0136", "0.5981"),
];

/// A pair of view and light that was published image by image, degrees.
const PAIR_7_1: [[f32; 2]; 2] = [[15.0, 60.0], [60.0, 342.0]];

/// Published figures: boxes, how they are split, mean and largest error, ratio to the JPEG files.
const TABLE_8_1: [(&str, &str, &str, &str, &str); 3] = [
    ("256", "balanced", "0.097", "0.162", "192.308"),
    ("256", "longest-edge", "0.075", "0.131", "161.031"),
    ("400", "longest-edge", "0.062", "0.116", "80.000"),
];

pub struct Story<'a> {
    pub sweep: &'a Sweep,
    pub source: &'a Arc<dyn BtfSource>,
    pub rows: &'a [SweepRow],
}

impl Story<'_> {
    pub fn write(&self, terminal: &Terminal) -> anyhow::Result<String> {
        let name = self.sweep.source.file_stem().unwrap_or_default().to_string_lossy();
        let meta = self.source.meta();
        let raw = report::bytes(meta.raw8_bytes());
        let lead = format!(
            "{} images of {} x {} texels, {raw} raw, compressed by every method.",
            meta.pairs(),
            meta.width,
            meta.height
        );
        let mut page = Page::new(&format!("{name}: bytes and errors"), &lead).small(QUALITY);
        page.svg(&rate_distortion(&self.curves()));
        self.figures(&mut page);
        self.published(&mut page);
        self.components(Some(&mut page))?;
        self.lossless(&mut page);
        self.angles(&mut page);
        let shown = self.shown();
        self.objects(&mut page, &shown, terminal)?;
        self.photographs(&mut page, &shown)?;
        page.heading("The command");
        page.code(&self.sweep.command());
        Ok(page.finish())
    }

    fn curves(&self) -> Vec<(String, Vec<(f64, f64)>)> {
        let of = |method: &str| {
            let rows = self.rows.iter().filter(|entry| entry.row.method == method);
            rows.map(|entry| (entry.row.bytes as f64, entry.row.report.mean_abs_error)).collect()
        };
        methods(self.rows).into_iter().map(|method| (method.to_owned(), of(method))).collect()
    }

    fn shown(&self) -> Vec<&SweepRow> {
        job::middling(self.rows, self.source.meta()).into_iter().map(|i| &self.rows[i]).collect()
    }

    fn figures(&self, page: &mut Page) {
        page.heading("All figures");
        page.paragraph(
            "Errors are over all texels, channels and images, in the images' own encoding, as fractions of 255; \
             CIEDE2000 and FLIP are means over the images shown below. Memory is the peak of a process that only encodes.",
        );
        let header = [
            "method",
            "mean error",
            "max error",
            "PSNR dB",
            "SSIM",
            "CIEDE2000",
            "FLIP",
            "bytes",
            "resident",
            "raw / bytes",
            "files / bytes",
            "encode s",
            "decode s",
            "memory",
        ];
        let row = |entry: &SweepRow| {
            let (row, error) = (&entry.row, &entry.row.report);
            vec![
                label(entry),
                format!("{:.4}", error.mean_abs_error),
                format!("{:.3}", error.max_abs_error),
                format!("{:.2}", error.psnr_db),
                format!("{:.4}", error.ssim),
                format!("{:.2}", entry.detail.ciede2000),
                format!("{:.4}", entry.detail.flip),
                report::bytes(row.bytes),
                report::bytes(entry.resident_bytes),
                format!("{:.1}", row.ratio_raw8),
                format!("{:.2}", row.ratio_source),
                row.encode_s.map_or("-".into(), |s| format!("{s:.2}")),
                format!("{:.2}", row.decode_s),
                row.peak_rss_bytes.map_or("-".into(), report::bytes),
            ]
        };
        page.table(&header, &self.rows.iter().map(row).collect::<Vec<_>>());
    }

    /// The tables of 2006 beside the figures here for the same settings.
    fn published(&self, page: &mut Page) {
        page.heading("In the units of 2006");
        page.paragraph(
            "Mean errors and ratios to the JPEG files as published, for other materials at 256 x 256, beside the same settings here. The maximum here is that of single numbers over all texels and \
             images; the published one is at most 1.9 times the mean error, so it is probably the largest mean error of an image.",
        );
        let find = |method: &str, words: &[String]| {
            let fits = |entry: &&SweepRow| {
                entry.row.method == method && words.iter().all(|w| entry.flags.contains(w.as_str()))
            };
            self.rows.iter().find(fits)
        };
        let here = |entry: Option<&SweepRow>, max: bool| {
            let text = |value: Option<String>| value.unwrap_or("-".into());
            let mut cells = vec![text(entry.map(|e| format!("{:.4}", e.row.report.mean_abs_error)))];
            cells.extend(max.then(|| text(entry.map(|e| format!("{:.3}", e.row.report.max_abs_error)))));
            cells.push(text(entry.map(|e| format!("{:.4}", e.row.ratio_source))));
            cells
        };
        let pvmf = TABLE_7_1.map(|(c, error, ratio)| {
            let found = self.rows.iter().find(|e| e.row.method == "pvmf" && e.flags == format!("--components {c}"));
            [vec![c.to_owned(), error.to_owned(), ratio.to_owned()], here(found, false)].concat()
        });
        page.table(&["PVMF, components", "error 2006", "ratio 2006", "error here", "ratio here"], &pvmf);
        page.svg(&error_of_components(&self.by_components()));
        let boxes = TABLE_8_1.map(|(count, split, mean, max, ratio)| {
            let found = find("median-cut", &[format!("--clusters {count}"), format!("--split {split}")]);
            let published = [mean, max, ratio].map(str::to_owned).to_vec();
            [vec![format!("{count} {split}")], published, here(found, true)].concat()
        });
        let header =
            ["median cut, boxes", "mean 2006", "max 2006", "ratio 2006", "mean here", "max here", "ratio here"];
        page.table(&header, &boxes);
        self.counted(page);
    }

    /// The error over the components of PVMF, published and here.
    fn by_components(&self) -> [(String, Vec<(f64, f64)>); 2] {
        let number = |text: &str| text.parse().unwrap_or(0.0);
        let here = |entry: &SweepRow| {
            let components = entry.flags.strip_prefix("--components ").filter(|_| entry.row.method == "pvmf");
            components.map(|c| (number(c), entry.row.report.mean_abs_error))
        };
        let published = TABLE_7_1.iter().map(|(c, error, _)| (number(c), number(error))).collect();
        [("2006".to_owned(), published), ("pvmf here".to_owned(), self.rows.iter().filter_map(here).collect())]
    }

    /// What every number of components of PVMF makes of one image, as in the pictures of 2006; `None` without PVMF. The
    /// picture has the images and, below them, the errors.
    pub fn components(&self, page: Option<&mut Page>) -> loden::Result<Option<Picture>> {
        let found: Vec<&SweepRow> = self.rows.iter().filter(|entry| entry.row.method == "pvmf").collect();
        if found.is_empty() {
            return Ok(None);
        }
        let meta = self.source.meta();
        let nearest = |[theta, phi]: [f32; 2]| from_angles(theta.to_radians(), phi.to_radians());
        let (view, light) = meta.nearest_pair(nearest(PAIR_7_1[1]), nearest(PAIR_7_1[0]));
        let original = self.source.image(view, light)?.to_f32().into_owned();
        let mut images = vec![("original".to_owned(), stored_picture(meta, &original))];
        let mut errors = vec![(format!("errors x {ERROR_GAIN}"), error_picture(meta, &original, &original))];
        for entry in found {
            let decoded = codec::open(&entry.row.file)?.image(view, light)?.to_f32().into_owned();
            let name = entry.flags.replace("--components ", "c = ");
            images.push((name, stored_picture(meta, &decoded)));
            errors.push((String::new(), error_picture(meta, &original, &decoded)));
        }
        if let Some(page) = page {
            page.heading("By components");
            let [[tl, pl], [tv, pv]] = meta.pair_degrees(view, light);
            page.paragraph(&format!(
                "One image, light {tl}, {pl}; view {tv}, {pv}, and what pvmf makes of it with c components; below the \
                 absolute errors, {ERROR_GAIN} times as bright."
            ));
            rows(page, &images, images.len(), true);
            rows(page, &errors, errors.len(), true);
        }
        let columns = images.len();
        Ok(Some(job::side_by_side(&[images, errors].concat(), columns)))
    }

    /// The formulas of 2006 for what a method keeps, as a share of the data.
    fn counted(&self, page: &mut Page) {
        let meta = self.source.meta();
        let (views, lights) = (meta.views.len() as f64, meta.lights.len() as f64);
        let share = |value: f64| format!("{:.5}", value);
        let texels = meta.texels() as f64;
        let rows = [
            ("cmf", "(L + V) / (L V)", (lights + views) / (lights * views)),
            ("pca", "1 / c, c = 16", 1.0 / 16.0),
            ("svd", "1 / c, c = 16", 1.0 / 16.0),
            ("pvmf", "c / V, c = 4", 4.0 / views),
            ("pcmf", "c k / N^2, c = 8, k = 32", 256.0 / texels),
        ];
        let nearest = |method: &str, share: f64| {
            let far = |entry: &&SweepRow| (entry.row.ratio_raw8 * share).ln().abs();
            self.rows.iter().filter(|e| e.row.method == method).min_by(|a, b| far(a).total_cmp(&far(b)))
        };
        let rows = rows.map(|(method, formula, value)| {
            let here = nearest(method, value).map_or(vec!["-".to_owned(); 3], |entry| {
                vec![label(entry), share(1.0 / entry.row.ratio_raw8), format!("{:.4}", entry.row.report.mean_abs_error)]
            });
            [vec![method.to_owned(), formula.to_owned(), share(value)], here].concat()
        });
        page.table(&["method", "share kept, 2006", "value", "nearest here", "bytes / raw", "mean error"], &rows);
    }

    /// What is left after a lossless stage.
    fn lossless(&self, page: &mut Page) {
        page.heading("With a lossless stage");
        page.paragraph(
            "Packed size over the size of the file: numbers packed as they are, and shuffled, the first bytes of all numbers \
             before the second ones. The files themselves are not packed (loden compress --lossless packs them).",
        );
        let mut header = vec!["method".to_owned(), "bytes".to_owned()];
        let stages = self.rows.iter().flat_map(|entry| &entry.lossless).take(STAGES.len());
        header.extend(stages.flat_map(|rate| [rate.stage.to_owned(), format!("{}, shuffled", rate.stage)]));
        let row = |entry: &&SweepRow| {
            let share = |bytes: u64| format!("{:.3}", bytes as f64 / entry.row.bytes as f64);
            let rates = entry.lossless.iter().flat_map(|rate| [share(rate.plain), share(rate.shuffled)]);
            [label(entry), report::bytes(entry.row.bytes)].into_iter().chain(rates).collect()
        };
        let header: Vec<&str> = header.iter().map(String::as_str).collect();
        page.table(&header, &self.shown().iter().map(row).collect::<Vec<_>>());
    }

    /// Errors over the polar angle, and the worst places.
    fn angles(&self, page: &mut Page) {
        page.heading("Where the errors are");
        page.paragraph("Mean error of the views at each polar angle, of the lights at each polar angle, and the worst pair and texel.");
        let shown = self.shown();
        let meta = self.source.meta();
        let angles =
            |of: &str, rings: &[(f64, f64)]| rings.iter().map(|(theta, _)| format!("{of} {theta:.0}°")).collect();
        let detail = &shown[0].detail;
        let mut header: Vec<String> = vec!["method".into()];
        header.extend::<Vec<String>>(angles("view", &detail.by_view));
        header.extend::<Vec<String>>(angles("light", &detail.by_light));
        header.extend(["worst view; light", "error", "worst texel", "error"].map(str::to_owned));
        let row = |entry: &&SweepRow| {
            let detail = &entry.detail;
            let rings = detail.by_view.iter().chain(&detail.by_light);
            let mut cells = vec![label(entry)];
            cells.extend(rings.map(|(_, error)| format!("{error:.4}")));
            let ((view, light), (x, y)) = (detail.worst_pair, detail.worst_texel);
            let [[tl, pl], [tv, pv]] = meta.pair_degrees(view, light);
            cells.push(format!("{tv:.0}, {pv:.0}; {tl:.0}, {pl:.0}"));
            cells.push(format!("{:.4}", detail.worst_pair_error));
            cells.push(format!("{x}, {y}"));
            cells.push(format!("{:.4}", detail.worst_texel_error));
            cells
        };
        let header: Vec<&str> = header.iter().map(String::as_str).collect();
        page.table(&header, &shown.iter().map(row).collect::<Vec<_>>());
    }

    /// The material on a cloth.
    fn objects(&self, page: &mut Page, shown: &[&SweepRow], terminal: &Terminal) -> anyhow::Result<()> {
        page.heading("On an object");
        if shown.iter().any(|entry| entry.row.method == "analytic") {
            page.paragraph(
                "A fitted lobe may be far brighter than the images where they are saturated or beyond the measured angles; \
                 paths that meet it show as bright dots.",
            );
        }
        let (size, spp) = if self.sweep.draft { (96, 4) } else { (256, 32) };
        let look = Look::new("sphere", size, size, spp);
        let original = RawBtf::new(self.source.clone(), Scheme::Triangles)?;
        let mut pictures = vec![("images".to_owned(), draw(&look, &original, "images", terminal)?)];
        for entry in shown {
            let material: Arc<dyn Material> = codec::open(&entry.row.file)?.material(Scheme::Triangles)?;
            pictures.push((label(entry), draw(&look, material.as_ref(), &entry.row.method, terminal)?));
        }
        rows(page, &pictures, 4, false);
        Ok(())
    }

    /// Decoded images and errors.
    fn photographs(&self, page: &mut Page, shown: &[&SweepRow]) -> loden::Result<()> {
        page.heading("Image by image");
        page.paragraph(&format!(
            "The image and what each method makes of it; below them the absolute errors, {ERROR_GAIN} times as bright."
        ));
        let meta = self.source.meta();
        for (view, light) in shown_pairs(meta) {
            let original = self.source.image(view, light)?.to_f32().into_owned();
            let [[tl, pl], [tv, pv]] = meta.pair_degrees(view, light);
            for some in shown.chunks(BESIDE) {
                let mut images = vec![(format!("light {tl}, {pl}; view {tv}, {pv}"), stored_picture(meta, &original))];
                let mut errors = vec![("errors".to_owned(), error_picture(meta, &original, &original))];
                for entry in some {
                    let decoded = codec::open(&entry.row.file)?.image(view, light)?.to_f32().into_owned();
                    images.push((label(entry), stored_picture(meta, &decoded)));
                    errors.push((String::new(), error_picture(meta, &original, &decoded)));
                }
                rows(page, &images, 1 + BESIDE, true);
                rows(page, &errors, 1 + BESIDE, true);
            }
        }
        Ok(())
    }
}

/// Pictures in rows of `count`.
fn rows(page: &mut Page, pictures: &[(String, Picture)], count: usize, texels: bool) {
    for row in pictures.chunks(count) {
        let row: Vec<_> = row.iter().map(|(caption, picture)| (caption.clone(), picture)).collect();
        page.pictures_of(&row, count, texels);
    }
}

/// Method and setting.
fn label(entry: &SweepRow) -> String {
    format!("{} {}", entry.row.method, entry.flags.replace("--", ""))
}

/// The methods in order.
fn methods(rows: &[SweepRow]) -> Vec<&str> {
    let mut methods: Vec<&str> = rows.iter().map(|row| row.row.method.as_str()).collect();
    methods.dedup();
    methods
}
