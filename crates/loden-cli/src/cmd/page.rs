//! A self-contained HTML page: text, tables and pictures in one file.

use std::fmt::Write;

use base64::Engine;
use loden::picture::Picture;

/// A page being written from top to bottom. All text is escaped.
pub struct Page {
    html: String,
    /// JPEG quality of the pictures; PNG if none.
    quality: Option<u8>,
}

const STYLE: &str = "
:root { color-scheme: light dark; --line: #8884; --soft: #777; }
body { font: 16px/1.55 system-ui, sans-serif; max-width: 1100px; margin: 2.5rem auto; padding: 0 1.25rem; }
h1 { font-size: 2rem; margin: 0 0 .25rem; letter-spacing: -.02em; } h2 { margin: 2.6rem 0 .6rem; font-size: 1.25rem; }
p.lead { font-size: 1.1rem; color: var(--soft); margin-top: 0; }
figure { margin: 0; } figure.chart { margin: 1.2rem 0; } figure svg { max-width: 100%; height: auto; border-radius: 4px; } figcaption { font-size: .85rem; color: var(--soft); padding-top: .3rem; }
img { display: block; width: 100%; height: auto; border-radius: 4px; } img.texels { image-rendering: pixelated; }
.row { display: grid; gap: .8rem; margin: .9rem 0; grid-template-columns: repeat(var(--n), minmax(0, 1fr)); }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .3rem 1rem; } dt { font-weight: 600; } dd { margin: 0; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-variant-numeric: tabular-nums; width: 100%; font-size: .82rem; }
th, td { text-align: right; padding: .3rem .4rem; border-bottom: 1px solid var(--line); white-space: nowrap; }
th:first-child, td:first-child { text-align: left; } th { font-weight: 600; }
pre { background: #8881; padding: .9rem 1.1rem; border-radius: 6px; overflow-x: auto; font-size: .9rem; }
@media (max-width: 640px) {
  body { margin: 1rem auto; padding: 0 .8rem; } h1 { font-size: 1.6rem; } h2 { margin-top: 2rem; }
  .row { --n: 1 !important; gap: .5rem; } .row.many { --n: 2 !important; } .row.texels > :first-child { grid-column: 1 / -1; width: 50%; }
  dl { grid-template-columns: 1fr; gap: 0; } dd { margin-bottom: .6rem; }
  figure.chart { overflow-x: auto; } figure.chart svg { max-width: none; width: 680px; }
  pre { white-space: pre-wrap; overflow-wrap: anywhere; font-size: .8rem; }
}
";

impl Page {
    /// A page with a heading and one sentence below it.
    pub fn new(title: &str, lead: &str) -> Self {
        let (title, lead) = (escape(title), escape(lead));
        let html = format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{title}</title>\n<style>{STYLE}</style></head>\n<body>\n<h1>{title}</h1>\n<p class=\"lead\">{lead}</p>\n"
        );
        Self { html, quality: None }
    }

    /// Stores the pictures from here on as JPEG of this quality, for a small page.
    pub fn small(mut self, quality: u8) -> Self {
        self.quality = Some(quality);
        self
    }

    pub fn heading(&mut self, text: &str) {
        self.add(format_args!("<h2>{}</h2>\n", escape(text)));
    }

    pub fn paragraph(&mut self, text: &str) {
        self.add(format_args!("<p>{}</p>\n", escape(text)));
    }

    pub fn code(&mut self, text: &str) {
        self.add(format_args!("<pre>{}</pre>\n", escape(text)));
    }

    /// Pictures side by side with captions; `texels` keeps the pixels of small ones sharp.
    pub fn pictures(&mut self, pictures: &[(String, &Picture)], texels: bool) {
        self.pictures_of(pictures, pictures.len(), texels);
    }

    /// [`Page::pictures`] in a row with room for `count`.
    pub fn pictures_of(&mut self, pictures: &[(String, &Picture)], count: usize, texels: bool) {
        // on a phone pictures stand below each other, many of them in two columns
        let many = if count > 2 { " many" } else { "" };
        let kind = if texels { " texels" } else { "" };
        self.add(format_args!("<div class=\"row{many}{kind}\" style=\"--n:{count}\">\n"));
        for (caption, picture) in pictures {
            let class = if texels { " class=\"texels\"" } else { "" };
            let (caption, data) = (escape(caption), data_url(picture, self.quality));
            self.add(format_args!(
                "<figure><img{class} width=\"{}\" height=\"{}\" alt=\"{caption}\" src=\"{data}\"><figcaption>{caption}</figcaption></figure>\n",
                picture.width, picture.height
            ));
        }
        self.html.push_str("</div>\n");
    }

    /// Words and what they mean.
    pub fn definitions(&mut self, words: &[(&str, &str)]) {
        self.html.push_str("<dl>\n");
        for (word, meaning) in words {
            self.add(format_args!("<dt>{}</dt><dd>{}</dd>\n", escape(word), escape(meaning)));
        }
        self.html.push_str("</dl>\n");
    }

    /// A drawing.
    pub fn svg(&mut self, svg: &str) {
        self.add(format_args!("<figure class=\"chart\">{svg}</figure>\n"));
    }

    pub fn table(&mut self, header: &[&str], rows: &[Vec<String>]) {
        let cells = |tag: &str, cells: &mut dyn Iterator<Item = &str>| -> String {
            cells.map(|cell| format!("<{tag}>{}</{tag}>", escape(cell))).collect()
        };
        self.add(format_args!(
            "<div class=\"scroll\"><table><thead><tr>{}</tr></thead><tbody>\n",
            cells("th", &mut header.iter().copied())
        ));
        for row in rows {
            self.add(format_args!("<tr>{}</tr>\n", cells("td", &mut row.iter().map(String::as_str))));
        }
        self.html.push_str("</tbody></table></div>\n");
    }

    /// The whole page.
    pub fn finish(mut self) -> String {
        self.html.push_str("</body></html>\n");
        self.html
    }

    fn add(&mut self, text: std::fmt::Arguments<'_>) {
        // writing to a string cannot fail
        let _ = self.html.write_fmt(text);
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn data_url(picture: &Picture, quality: Option<u8>) -> String {
    // pictures of a page are never empty
    let (kind, bytes) = match quality {
        Some(quality) => ("jpeg", picture.to_jpeg(quality)),
        None => ("png", picture.to_png().ok()),
    };
    format!("data:image/{kind};base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes.unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped_and_pictures_are_inside() {
        let mut page = Page::new("a < b", "c & d");
        page.pictures(&[("\"e\"".into(), &Picture::filled(2, 1, glam::Vec3::ONE))], true);
        page.table(&["x"], &[vec!["<y>".into()]]);
        let html = page.finish();
        assert!(html.contains("a &lt; b") && html.contains("c &amp; d") && html.contains("&quot;e&quot;"));
        assert!(html.contains("&lt;y&gt;") && html.contains("data:image/png;base64,iVBOR"));
        assert!(!html.contains("http"), "nothing is fetched");
    }
}
