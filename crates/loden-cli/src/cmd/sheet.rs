//! `loden render --sheet`: the same object wearing a measurement and what compression made of it, side by side.

use std::path::Path;

use loden::job::{self, Look, Sheet, SheetRow, Worn};
use loden::metric::PictureReport;
use loden::progress::Progress;

use super::page::Page;
use crate::outputs::Target;
use crate::report;
use crate::terminal::Terminal;

/// Differences are shown this much larger.
const GAIN: f32 = 8.0;

/// Draws all materials and writes the sheet: a picture, or a page if the name ends in .html.
pub fn sheet(look: &Look, original: &Worn, others: &[Worn], target: Target, terminal: &Terminal) -> anyhow::Result<()> {
    let sheet = job::sheet(look, original, others, GAIN, terminal)?;
    if is_page(target.path()) {
        let html = page(original, &sheet);
        loden::output::write_file(target.path(), |file| file.write_all(html.as_bytes()))?;
    } else {
        sheet.picture()?.write_noted(target.path(), terminal.command())?;
    }
    target.finish()?;
    terminal.result(&sheet.rows, || table(&sheet.rows))
}

/// Whether a name ends in .html.
pub fn is_page(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("html"))
}

fn label(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn table(rows: &[SheetRow]) -> String {
    let cells = |row: &SheetRow| {
        let PictureReport { mean_abs_error, psnr_db, ssim, flip } = row.report;
        let numbers =
            [(mean_abs_error, 4), (psnr_db, 2), (ssim, 4), (flip, 4)].map(|(v, digits)| format!("{v:.digits$}"));
        [vec![row.file.display().to_string(), report::bytes(row.bytes)], numbers.to_vec()].concat()
    };
    report::table(&["file", "bytes", "mean", "psnr", "ssim", "flip"], &rows.iter().map(cells).collect::<Vec<_>>())
}

fn page(original: &Worn, sheet: &Sheet) -> String {
    let rows = &sheet.rows;
    let lead = "The same object under the same light; errors are of the displayed pictures, noise included.";
    let mut page = Page::new("Images or compression?", lead);
    let first = format!("{}, {}", label(&original.path), report::bytes(original.bytes));
    let others = rows.iter().map(|row| {
        let PictureReport { psnr_db, ssim, flip, .. } = row.report;
        format!(
            "{}, {}: PSNR {psnr_db:.1} dB, SSIM {ssim:.3}, FLIP {flip:.3}",
            label(&row.file),
            report::bytes(row.bytes)
        )
    });
    let captioned: Vec<_> = std::iter::once(first).chain(others).zip(&sheet.pictures).collect();
    page.pictures(&captioned, false);
    page.paragraph(&format!("Differences to the first, {GAIN} times:"));
    let differences: Vec<_> = rows.iter().map(|row| label(&row.file)).zip(&sheet.differences).collect();
    page.pictures(&differences, false);
    page.finish()
}
