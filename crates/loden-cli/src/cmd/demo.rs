//! `loden demo`: the main job from a measurement to a page about it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::Args;
use loden::btf::BtfSource;
use loden::codec::{self, CompressedBtf};
use loden::direction::Scheme;
use loden::job::{self, Comparison, ERROR_GAIN, Look, draw, error_picture, shown_pairs, stored_picture};
use loden::material::{Material, RawBtf};
use loden::progress::Progress;
use loden::{Error, acquire, memory, output};
use serde_json::json;

use super::compare;
use super::page::Page;
use crate::flags::Assumptions;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden demo
  loden demo wool.zip --components 4,9,16 --out wool")]
pub struct Demo {
    /// A BTF: any file or folder that `loden info` recognises [default: a simulated twill].
    source: Option<PathBuf>,
    /// Folder for the page and the compressed files.
    #[arg(long, default_value = "loden-demo", value_name = "DIR")]
    out: PathBuf,
    /// Numbers of components, one compressed file for each.
    #[arg(long, value_delimiter = ',', default_values_t = [2, 4, 9, 16], value_name = "C,...")]
    components: Vec<usize>,
    /// Texels per side of the simulated sample.
    #[arg(long, default_value_t = 64, value_name = "N")]
    size: usize,
    /// Paths per texel and view of the simulated sample.
    #[arg(long, default_value_t = 16, value_name = "N")]
    spp: u32,
    /// Render small, noisy pictures, for a first look.
    #[arg(long)]
    draft: bool,
    #[command(flatten)]
    assumptions: Assumptions,
}

impl Demo {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let start = Instant::now();
        std::fs::create_dir_all(&self.out).map_err(Error::io(&self.out))?;
        let path = self.measurement(terminal)?;
        let source = job::open_btf(&path, self.assumptions.given(), terminal)?;
        let rows = job::compress_components(source.as_ref(), &self.components, &self.out, terminal)?;
        let page = self.out.join("index.html");
        let html = Story { demo: &self, path: &path, source: &source, rows: &rows }.write(terminal)?;
        output::write_file(&page, |file| file.write_all(html.as_bytes()))?;
        let seconds = start.elapsed().as_secs_f64();
        let value = json!({ "page": page, "rows": rows, "seconds": seconds, "peak_rss_bytes": memory::peak() });
        terminal.result(&value, || format!("{}\nLook at {} ({seconds:.0} s)", compare::table(&rows), page.display()))
    }

    fn measurement(&self, terminal: &Terminal) -> anyhow::Result<PathBuf> {
        if let Some(path) = &self.source {
            return Ok(path.clone());
        }
        let path = self.out.join("twill.zip");
        let options = acquire::Options { size: self.size, spp: self.spp, ..acquire::Options::default() };
        terminal.stage(&format!("measuring a simulated twill: 81 x 81 images of {0} x {0} texels", self.size));
        job::built_in("twill", &options, &path, terminal)?;
        Ok(path)
    }
}

/// The content of the page.
struct Story<'a> {
    demo: &'a Demo,
    path: &'a Path,
    source: &'a Arc<dyn BtfSource>,
    rows: &'a [Comparison],
}

impl Story<'_> {
    fn write(&self, terminal: &Terminal) -> anyhow::Result<String> {
        let name = self.path.file_stem().unwrap_or_default().to_string_lossy();
        let meta = self.source.meta();
        let lead = format!(
            "{} photographs of {} x {} texels, {} of raw data, compressed and rendered.",
            meta.pairs(),
            meta.width,
            meta.height,
            report::bytes(meta.raw8_bytes())
        );
        let mut page = Page::new(&name, &lead);
        let compressed: Vec<Arc<CompressedBtf>> =
            self.rows.iter().map(|row| codec::open(&row.file)).collect::<loden::Result<_>>()?;
        self.objects(&mut page, &compressed, terminal)?;
        self.figures(&mut page);
        self.photographs(&mut page, &compressed)?;
        self.commands(&mut page);
        Ok(page.finish())
    }

    /// The material on objects: compressed, then the photographs beside every compressed form.
    fn objects(&self, page: &mut Page, compressed: &[Arc<CompressedBtf>], terminal: &Terminal) -> anyhow::Result<()> {
        let materials: Vec<Arc<dyn Material>> =
            compressed.iter().map(|c| c.material(Scheme::Triangles)).collect::<loden::Result<_>>()?;
        let best = self
            .rows
            .iter()
            .position(|row| row.params.get("components").is_ok_and(|count: usize| count == 9))
            .unwrap_or(self.rows.len() - 1);
        terminal.stage("rendering");
        let hero = self.look("teapot", 960, 600, 64);
        let picture = draw(&hero, materials[best].as_ref(), &self.label(best), terminal)?;
        picture.write(self.demo.out.join("teapot.png"))?;
        page.pictures(&[(format!("A teapot wearing {}", self.label(best)), &picture)], false);

        let small = |object| self.look(object, 480, 384, 32);
        let cloth = draw(&small("cloth"), materials[best].as_ref(), &self.label(best), terminal)?;
        let sphere = draw(&small("sphere"), materials[best].as_ref(), &self.label(best), terminal)?;
        page.pictures(&[("The same as a cloth".into(), &cloth), ("and on a sphere".into(), &sphere)], false);

        page.heading("Photographs or compression?");
        page.paragraph(
            "The first picture is rendered from the photographs themselves, the others from the compressed files.",
        );
        let original = RawBtf::new(self.source.clone(), Scheme::Triangles)?;
        let close = self.look("sphere", 256, 256, 32);
        let mut pictures = vec![("photographs".to_owned(), draw(&close, &original, "photographs", terminal)?)];
        for (i, material) in materials.iter().enumerate() {
            pictures.push((self.label(i), draw(&close, material.as_ref(), &self.label(i), terminal)?));
        }
        let pictures: Vec<_> = pictures.iter().map(|(caption, picture)| (caption.clone(), picture)).collect();
        page.pictures(&pictures, false);
        Ok(())
    }

    fn look(&self, object: &str, width: usize, height: usize, spp: u32) -> Look {
        if self.demo.draft {
            Look::new(object, width / 8, height / 8, 4)
        } else {
            Look::new(object, width, height, spp)
        }
    }

    fn label(&self, i: usize) -> String {
        format!("{} {} ({})", self.rows[i].method, short(&self.rows[i]), report::bytes(self.rows[i].bytes))
    }

    fn figures(&self, page: &mut Page) {
        page.heading("How good, how small");
        page.paragraph(
            "Errors are over all texels, channels and photographs, in the photographs' own encoding, as fractions of 255: \
             0.035 is 8.9 grey levels.",
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

    /// Originals beside reconstructions beside error images.
    fn photographs(&self, page: &mut Page, compressed: &[Arc<CompressedBtf>]) -> loden::Result<()> {
        page.heading("Photograph by photograph");
        page.paragraph(&format!(
            "Each row is one pair of directions: the photograph, then the reconstruction and the absolute error ({ERROR_GAIN} times as \
             bright) of the coarsest and the finest compressed file."
        ));
        let meta = self.source.meta();
        let mut chosen = vec![0, compressed.len() - 1];
        chosen.dedup();
        for (v, l) in shown_pairs(meta) {
            let original = self.source.image(v, l)?.to_f32().into_owned();
            let ([tl, pl], [tv, pv]) = (meta.lights.degrees()[l], meta.views.degrees()[v]);
            let mut pictures = vec![(format!("light {tl}, {pl}; view {tv}, {pv}"), stored_picture(meta, &original))];
            for &i in &chosen {
                let decoded = compressed[i].image(v, l)?.to_f32().into_owned();
                pictures.push((short(&self.rows[i]), stored_picture(meta, &decoded)));
                pictures.push((format!("error x {ERROR_GAIN}"), error_picture(meta, &original, &decoded)));
            }
            let pictures: Vec<_> = pictures.iter().map(|(caption, picture)| (caption.clone(), picture)).collect();
            page.pictures(&pictures, true);
        }
        Ok(())
    }

    fn commands(&self, page: &mut Page) {
        page.heading("The commands");
        let mut lines = Vec::new();
        let source = self.path.display();
        if self.demo.source.is_none() {
            lines.push(format!("loden acquire twill --size {} --spp {} -o {source}", self.demo.size, self.demo.spp));
        }
        for row in self.rows {
            lines.push(format!(
                "loden compress {source} --method {} {} -o {}",
                row.method,
                as_flags(row),
                row.file.display()
            ));
        }
        let files: Vec<_> = self.rows.iter().map(|row| row.file.display().to_string()).collect();
        lines.push(format!("loden compare {source} {}", files.join(" ")));
        if let Some(row) = self.rows.last() {
            let out = self.demo.out.join("teapot.png");
            lines.push(format!(
                "loden render --object teapot --material {} --size 960x600 -o {}",
                row.file.display(),
                out.display()
            ));
        }
        page.code(&lines.join("\n"));
    }
}

/// The number of components, which is all that differs between the files.
fn short(row: &Comparison) -> String {
    format!("c = {}", row.params.written("components").unwrap_or_default())
}

fn as_flags(row: &Comparison) -> String {
    row.params.iter().map(|(name, text)| format!("--{name} {text}")).collect::<Vec<_>>().join(" ")
}
