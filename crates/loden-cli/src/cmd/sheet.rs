//! `loden render --sheet`: the same object wearing a measurement and what compression made of it, side by side.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::Vec3;
use loden::material::Material;
use loden::metric::{self, PictureReport};
use loden::picture::Picture;
use serde::Serialize;

use super::page::Page;
use super::render::{Look, draw};
use crate::report;
use crate::terminal::Terminal;

/// Differences are shown this much larger.
const GAIN: f32 = 8.0;

/// Pixels between the pictures of a sheet.
const GAP: usize = 6;

/// A material of a sheet.
pub struct Worn {
    pub path: PathBuf,
    pub material: Arc<dyn Material>,
    /// Of its file or files.
    pub bytes: u64,
}

/// How far the picture of a compressed material is from that of the original.
#[derive(Serialize)]
struct Row {
    file: PathBuf,
    bytes: u64,
    #[serde(flatten)]
    report: PictureReport,
}

/// Draws all of them and writes the sheet: a picture of two rows (below each compressed one the difference to the
/// original, eight times), or a page that says so, if the name ends in .html.
pub fn sheet(look: &Look, original: &Worn, others: &[Worn], output: &Path, terminal: &Terminal) -> anyhow::Result<()> {
    let drawn = |worn: &Worn| {
        let name = worn.path.display().to_string();
        terminal.say(&format!("rendering {name}"));
        draw(look, worn.material.as_ref(), &name, terminal)
    };
    let reference = drawn(original)?;
    let mut pictures = vec![reference.clone()];
    let mut differences = vec![Picture::filled(reference.width, reference.height, Vec3::ONE)];
    let mut rows = Vec::new();
    for worn in others {
        let picture = drawn(worn)?;
        let report = metric::pictures(&reference, &picture)?;
        differences.push(metric::difference(&reference, &picture, GAIN)?);
        pictures.push(picture);
        rows.push(Row { file: worn.path.clone(), bytes: worn.bytes, report });
    }
    if is_page(output) {
        let html = page(original, &rows, &pictures, &differences[1..]);
        loden::output::write_file(output, |file| file.write_all(html.as_bytes()))?;
    } else {
        grid(&[pictures, differences]).write(output)?;
    }
    terminal.result(&rows, || table(&rows))
}

/// Whether a name ends in .html.
pub fn is_page(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("html"))
}

fn label(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn table(rows: &[Row]) -> String {
    let cells = |row: &Row| {
        let PictureReport { mean_abs_error, psnr_db, ssim, flip } = row.report;
        let numbers =
            [(mean_abs_error, 4), (psnr_db, 2), (ssim, 4), (flip, 4)].map(|(v, digits)| format!("{v:.digits$}"));
        [vec![row.file.display().to_string(), report::bytes(row.bytes)], numbers.to_vec()].concat()
    };
    report::table(&["file", "bytes", "mean", "psnr", "ssim", "flip"], &rows.iter().map(cells).collect::<Vec<_>>())
}

fn page(original: &Worn, rows: &[Row], pictures: &[Picture], differences: &[Picture]) -> String {
    let lead = "The same object under the same light; errors are of the displayed pictures, noise included.";
    let mut page = Page::new("Photographs or compression?", lead);
    let first = format!("{}, {}", label(&original.path), report::bytes(original.bytes));
    let others = rows.iter().map(|row| {
        let PictureReport { psnr_db, ssim, flip, .. } = row.report;
        format!(
            "{}, {}: PSNR {psnr_db:.1} dB, SSIM {ssim:.3}, FLIP {flip:.3}",
            label(&row.file),
            report::bytes(row.bytes)
        )
    });
    let captioned: Vec<_> = std::iter::once(first).chain(others).zip(pictures).collect();
    page.pictures(&captioned, false);
    page.paragraph(&format!("Differences to the first, {GAIN} times:"));
    let differences: Vec<_> = rows.iter().map(|row| label(&row.file)).zip(differences).collect();
    page.pictures(&differences, false);
    page.finish()
}

/// Pictures of one size in rows and columns on white.
fn grid(rows: &[Vec<Picture>]) -> Picture {
    let (width, height) = (rows[0][0].width, rows[0][0].height);
    let size = |count: usize, side: usize| count * side + count.saturating_sub(1) * GAP;
    let mut sheet = Picture::filled(size(rows[0].len(), width), size(rows.len(), height), Vec3::ONE);
    for (row, pictures) in rows.iter().enumerate() {
        for (column, picture) in pictures.iter().enumerate() {
            for (y, line) in picture.rgb.chunks_exact(width).enumerate() {
                let at = (row * (height + GAP) + y) * sheet.width + column * (width + GAP);
                sheet.rgb[at..][..width].copy_from_slice(line);
            }
        }
    }
    sheet
}
