//! The page of a demo.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use loden::btf::BtfSource;
use loden::codec::{self, CompressedBtf};
use loden::direction::Scheme;
use loden::job::{self, Comparison, ERROR_GAIN, Look, Worn, draw, error_picture, shown_pairs, stored_picture};
use loden::material::RawBtf;
use loden::plot::rate_distortion;
use loden::progress::Progress;

use super::Demo;
use super::commands::Commands;
use crate::cmd::page::Page;
use crate::report;
use crate::terminal::Terminal;

/// Amplification of the differences between rendered pictures.
const GAIN: f32 = 8.0;

/// The content of the page.
pub struct Story<'a> {
    pub demo: &'a Demo,
    pub path: &'a Path,
    pub source: &'a Arc<dyn BtfSource>,
    /// The default method with its default parameters first.
    pub rows: &'a [Comparison],
}

impl Story<'_> {
    pub fn write(&self, mut commands: Commands, terminal: &Terminal) -> anyhow::Result<String> {
        let name = self.path.file_stem().unwrap_or_default().to_string_lossy();
        let meta = self.source.meta();
        let (pairs, images) = (meta.pairs(), self.images());
        let raw = report::bytes(meta.raw8_bytes());
        let lead = format!(
            "{pairs} {images} of {} x {} texels, {raw} of raw data, compressed and rendered.",
            meta.width, meta.height
        );
        let mut page = Page::new(&name, &lead);
        terminal.stage("rendering");
        self.objects(&mut page, &mut commands, terminal)?;
        self.sizes(&mut page);
        self.sheet(&mut page, &mut commands, terminal)?;
        self.figures(&mut page);
        self.pairs(&mut page)?;
        page.heading("The commands");
        page.paragraph("What this page shows, made by hand:");
        page.code(&commands.text());
        Ok(page.finish())
    }

    /// What the source consists of: nothing was photographed where a sample was simulated.
    fn images(&self) -> &'static str {
        if self.demo.source.is_none() { "simulated images" } else { "images" }
    }

    fn file(&self, name: &str) -> PathBuf {
        self.demo.out.join(name)
    }

    /// The material on objects, from the file of the default method.
    fn objects(&self, page: &mut Page, commands: &mut Commands, terminal: &Terminal) -> anyhow::Result<()> {
        let row = &self.rows[0];
        let material = codec::open(&row.file)?.material(Scheme::Triangles)?;
        let mut picture = |object: &str, size: [usize; 2], spp: u32| -> anyhow::Result<_> {
            let look = Look { denoise: true, ..self.demo.look(object, size, spp) };
            let path = self.file(&format!("{object}.png"));
            let picture = draw(&look, material.as_ref(), &row.file.display().to_string(), terminal)?;
            picture.write_noted(&path, terminal.command())?;
            commands.render(&look, &row.file, &path);
            Ok(picture)
        };
        let caption = format!("A teapot wearing {}", label(row));
        page.pictures(&[(caption, &picture("teapot", [960, 600], 64)?)], false);
        let (cloth, sphere) = (picture("cloth", [480, 384], 32)?, picture("sphere", [480, 384], 32)?);
        page.pictures(&[("The same as a cloth".into(), &cloth), ("and on a sphere".into(), &sphere)], false);
        Ok(())
    }

    /// The rate chart and what each method is.
    fn sizes(&self, page: &mut Page) {
        page.heading("How small it gets");
        let default = &self.rows[0];
        let mut text = format!(
            "{} takes {}, 1/{:.0} of the raw data, at a mean error of {:.1} grey levels of 255.",
            default.method,
            report::bytes(default.bytes),
            default.ratio_raw8,
            255.0 * default.report.mean_abs_error
        );
        let as_good = |row: &&Comparison| {
            row.method != default.method && row.report.mean_abs_error <= default.report.mean_abs_error
        };
        if let Some(other) = self.rows.iter().filter(as_good).min_by_key(|row| row.bytes) {
            let times = other.bytes as f64 / default.bytes as f64;
            text += &format!(
                " The smallest file of the other methods here that is as good, {}, is {times:.0} times as large.",
                label(other)
            );
        }
        page.paragraph(&text);
        let mut methods: Vec<&str> = self.rows.iter().map(|row| row.method.as_str()).collect();
        methods.dedup();
        let curve = |method: &&str| {
            let rows = self.rows.iter().filter(|row| row.method == *method);
            ((*method).to_owned(), rows.map(|row| (row.bytes as f64, row.report.mean_abs_error)).collect())
        };
        page.svg(&rate_distortion(&methods.iter().map(curve).collect::<Vec<_>>()));
        let explained = methods.iter().filter_map(|method| Some((*method, codec::by_name(method).ok()?.doc())));
        page.definitions(&explained.collect::<Vec<_>>());
    }

    /// An object with the images themselves, and with every compressed file.
    fn sheet(&self, page: &mut Page, commands: &mut Commands, terminal: &Terminal) -> anyhow::Result<()> {
        page.heading("Images or compression?");
        page.paragraph(&format!(
            "The first picture is rendered from the {} themselves, the others from the compressed files.",
            self.images()
        ));
        let original = Worn {
            path: self.path.into(),
            material: Arc::new(RawBtf::new(self.source.clone(), Scheme::Triangles)?),
            bytes: self.source.source_bytes(),
        };
        let worn = |row: &Comparison| Worn::open(&row.file, Scheme::Triangles, &Default::default(), terminal);
        let others = self.rows.iter().map(worn).collect::<loden::Result<Vec<_>>>()?;
        let look = self.demo.look("sphere", [256, 256], 32);
        let sheet = job::sheet(&look, &original, &others, GAIN, terminal)?;
        let path = self.file("sheet.png");
        sheet.picture()?.write_noted(&path, terminal.command())?;
        let files: Vec<&Path> = self.rows.iter().map(|row| row.file.as_path()).collect();
        commands.sheet(&look, self.path, &files, &path);
        let first = format!("{}, {}", self.images(), report::bytes(original.bytes));
        let captions = std::iter::once(first).chain(self.rows.iter().map(label));
        let pictures: Vec<_> = captions.zip(&sheet.pictures).collect();
        pictures.chunks(4).for_each(|row| page.pictures_of(row, 4, false));
        Ok(())
    }

    fn figures(&self, page: &mut Page) {
        page.heading("All figures");
        page.paragraph(
            "Errors are over all texels, channels and images, in the images' own encoding, as fractions of 255: 0.035 is 8.9 \
             grey levels.",
        );
        let header = [
            "method",
            "mean error",
            "max error",
            "PSNR dB",
            "SSIM",
            "bytes",
            "raw / bytes",
            "files / bytes",
            "encode s",
            "decode s",
        ];
        let row = |row: &Comparison| {
            vec![
                format!("{} {}", row.method, short(row)),
                format!("{:.4}", row.report.mean_abs_error),
                format!("{:.3}", row.report.max_abs_error),
                format!("{:.2}", row.report.psnr_db),
                format!("{:.4}", row.report.ssim),
                report::bytes(row.bytes),
                format!("{:.1}", row.ratio_raw8),
                format!("{:.2}", row.ratio_source),
                row.encode_s.map_or("-".into(), |s| format!("{s:.2}")),
                format!("{:.2}", row.decode_s),
            ]
        };
        page.table(&header, &self.rows.iter().map(row).collect::<Vec<_>>());
    }

    /// Originals beside reconstructions beside errors.
    fn pairs(&self, page: &mut Page) -> loden::Result<()> {
        page.heading("Image by image");
        // the default, and the smallest file of another method
        let other = (1..self.rows.len())
            .filter(|i| self.rows[*i].method != self.rows[0].method)
            .min_by_key(|i| self.rows[*i].bytes);
        let chosen: Vec<usize> = std::iter::once(0).chain(other).collect();
        let names = chosen.iter().map(|i| label(&self.rows[*i])).collect::<Vec<_>>().join(" and ");
        page.paragraph(&format!(
            "Each row is one pair of directions: the image, then what was decoded from {names}, each with its absolute error, \
             {ERROR_GAIN} times as bright."
        ));
        let files = chosen.iter().map(|i| codec::open(&self.rows[*i].file));
        let files: Vec<Arc<CompressedBtf>> = files.collect::<loden::Result<_>>()?;
        let meta = self.source.meta();
        for (v, l) in shown_pairs(meta) {
            let original = self.source.image(v, l)?.to_f32().into_owned();
            let [[tl, pl], [tv, pv]] = meta.pair_degrees(v, l);
            let mut pictures = vec![(format!("light {tl}, {pl}; view {tv}, {pv}"), stored_picture(meta, &original))];
            for (file, &i) in files.iter().zip(&chosen) {
                let decoded = file.image(v, l)?.to_f32().into_owned();
                pictures.push((self.rows[i].method.clone(), stored_picture(meta, &decoded)));
                pictures.push((format!("error x {ERROR_GAIN}"), error_picture(meta, &original, &decoded)));
            }
            let pictures: Vec<_> = pictures.iter().map(|(caption, picture)| (caption.clone(), picture)).collect();
            page.pictures(&pictures, true);
        }
        Ok(())
    }
}

fn label(row: &Comparison) -> String {
    format!("{} {} ({})", row.method, short(row), report::bytes(row.bytes))
}

/// The parameters that differ between files of a method.
fn short(row: &Comparison) -> String {
    let shown = [("components", "c"), ("step", "step"), ("clusters", "k")];
    let value = |(name, short): (&str, &str)| {
        let text = row.params.written(name).ok()?;
        let number =
            text.parse::<f64>().map_or(text.to_owned(), |number| format!("{}", (number * 100.0).round() / 100.0));
        Some(format!("{short} = {number}"))
    };
    shown.into_iter().filter_map(value).collect::<Vec<_>>().join(", ")
}
