//! Numbers as text: byte counts and tables.

use std::fmt::Write;

/// A byte count as a person reads it.
pub fn bytes(count: u64) -> String {
    let mut value = count as f64;
    for unit in ["B", "kB", "MB", "GB"] {
        if value < 1000.0 {
            return if unit == "B" { format!("{count} B") } else { format!("{value:.3} {unit}") };
        }
        value /= 1000.0;
    }
    format!("{value:.3} TB")
}

/// A number with up to six significant digits.
pub fn short(number: f64) -> String {
    let rounded: f64 = format!("{number:.5e}").parse().unwrap_or(number);
    rounded.to_string()
}

/// A number of things, whose name takes an s for more than one.
pub fn count(number: usize, thing: &str) -> String {
    if number == 1 { format!("1 {thing}") } else { format!("{number} {thing}s") }
}

/// A text table: the first column to the left, the others to the right.
pub fn table(header: &[&str], rows: &[Vec<String>]) -> String {
    let width = |column: usize| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells.chain([header[column].chars().count()]).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..header.len()).map(width).collect();
    let mut text = String::new();
    let header: Vec<String> = header.iter().map(|cell| (*cell).to_owned()).collect();
    for row in std::iter::once(&header).chain(rows) {
        for (column, (cell, &width)) in row.iter().zip(&widths).enumerate() {
            // writing to a string cannot fail
            let _ = if column == 0 { write!(text, "{cell:<width$}") } else { write!(text, "  {cell:>width$}") };
        }
        text.truncate(text.trim_end().len());
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn byte_counts_read_well() {
        let texts = [999, 1000, 85_417_444, 1_289_945_088].map(bytes);
        assert_eq!(texts, ["999 B", "1.000 kB", "85.417 MB", "1.290 GB"]);
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(
            [0.1f32.into(), 1.0 / 3.0, 45.0, -1e-9, 0.0].map(short),
            ["0.1", "0.333333", "45", "-0.000000001", "0"]
        );
        assert_eq!([0, 1, 2].map(|n| count(n, "image")), ["0 images", "1 image", "2 images"]);
    }

    #[test]
    fn tables_align() {
        let rows = vec![vec!["a".to_owned(), "10".to_owned()], vec!["long".to_owned(), "9".to_owned()]];
        assert_eq!(table(&["name", "n"], &rows), "name   n\na     10\nlong   9\n");
    }
}
